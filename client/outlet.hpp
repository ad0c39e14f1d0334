// Outlet: what goes to stdout, without ever waiting for whoever reads it.
#pragma once

#include "client/exit_code.hpp"
#include "common/net/signals.hpp"

#include <optional>
#include <string>
#include <string_view>
#include <unistd.h>

namespace fraja::client {

/// Keeps what a slow reader (a pager, a stopped pipe) has not taken, in the order it was put. Of a
/// reader that has gone the system tells by SIGPIPE, as it does with any program. Nobody else may
/// write to the descriptor meanwhile.
class Outlet {
public:
    explicit Outlet(int fd = STDOUT_FILENO) : fd_(fd) {}

    void put(std::string_view text) { kept_ += text; }
    /// Writes what there is room for now.
    void pump();
    /// Writes the rest, at the reader's pace. A signal ends that, and is returned; the rest is then
    /// lost. `signals` may be null.
    [[nodiscard]] std::optional<int> drain(const net::SignalWatch* signals);

    /// Nothing waits for room.
    [[nodiscard]] bool is_empty() const { return begin_ == kept_.size(); }
    /// Something got lost: the disk is full, or the like. Nothing more is kept.
    [[nodiscard]] bool has_failed() const { return failed_; }
    [[nodiscard]] int fd() const { return fd_; }

private:
    int fd_;
    std::string kept_;
    std::size_t begin_ = 0; ///< what lies before it is written
    bool failed_ = false;
};

} // namespace fraja::client
