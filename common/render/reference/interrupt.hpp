// Interrupt: why a tile must end early, where every level of the search can see it.
#pragma once

#include "common/base/result.hpp"

#include <atomic>
#include <optional>
#include <string>

namespace fraja::reference {

/// Set once, by whoever finds a reason; from then on searches find nothing and return at once, and
/// the tile is the error. One thread's.
class Interrupt {
public:
    /// `stop` is asked by poll() and must outlive this.
    explicit Interrupt(const std::atomic<bool>& stop) : stop_(stop) {}

    /// Whether there is a reason to end.
    [[nodiscard]] bool raised() const { return error_.has_value(); }
    /// Only the first reason counts.
    void raise(ErrorCode code, std::string message) {
        if (!error_)
            error_ = Error{code, std::move(message)};
    }
    void poll() {
        if (stop_.load(std::memory_order_relaxed))
            raise(ErrorCode::cancelled, "stopped before the tile was drawn");
    }
    /// The reason; only when raised.
    [[nodiscard]] const Error& error() const { return *error_; }

private:
    const std::atomic<bool>& stop_;
    std::optional<Error> error_;
};

} // namespace fraja::reference
