// Board: where the broker's loop leaves its latest report for whoever wants to read it.
#pragma once

#include "broker/report.hpp"

#include <memory>
#include <mutex>
#include <utility>

namespace fraja::broker {

/// Any thread. Neither side waits for the other for longer than a pointer is copied.
class Board {
public:
    void post(Report report) {
        auto fresh = std::make_shared<const Report>(std::move(report));
        const std::lock_guard lock(mutex_);
        latest_.swap(fresh);
    }
    /// Null: there was none yet.
    [[nodiscard]] std::shared_ptr<const Report> latest() const {
        const std::lock_guard lock(mutex_);
        return latest_;
    }

private:
    mutable std::mutex mutex_;
    std::shared_ptr<const Report> latest_;
};

} // namespace fraja::broker
