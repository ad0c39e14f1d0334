// Signals as something to poll, instead of handlers.
#pragma once

#include <initializer_list>
#include <optional>

namespace fraja::net {

/// Blocks the signals in the calling thread and in those it starts later, so construct it first in
/// main.
class SignalWatch {
public:
    explicit SignalWatch(std::initializer_list<int> signals);
    ~SignalWatch();
    SignalWatch(const SignalWatch&) = delete;
    SignalWatch& operator=(const SignalWatch&) = delete;

    /// The next signal that came, if any. Never waits.
    [[nodiscard]] std::optional<int> receive() const;
    [[nodiscard]] int fd() const { return fd_; }

private:
    int fd_;
};

} // namespace fraja::net
