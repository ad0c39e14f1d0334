// Signals as something to poll, instead of handlers.
#pragma once

#include <csignal>
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
    friend class Unwatched;
    sigset_t signals_;
    int fd_;
};

/// While this lives the signals do to the program what they do to any: for what may wait for ever
/// before there is anything to lose, as the opening of a pipe. Only while there is one thread.
class Unwatched {
public:
    /// Null: nobody watches.
    explicit Unwatched(const SignalWatch* watch);
    ~Unwatched();
    Unwatched(const Unwatched&) = delete;
    Unwatched& operator=(const Unwatched&) = delete;

private:
    const SignalWatch* watch_;
};

} // namespace fraja::net
