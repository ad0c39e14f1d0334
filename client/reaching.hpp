// Reaching: whether anything can be reached at endpoints, looked into by a thread of its own, as
// names and firewalls may keep it waiting.
#pragma once

#include "common/net/waker.hpp"

#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

namespace fraja::client {

class Reaching {
public:
    explicit Reaching(const std::vector<std::string>& endpoints);
    /// Waits for a name that is being looked up; else it is left at once.
    ~Reaching();
    Reaching(const Reaching&) = delete;
    Reaching& operator=(const Reaching&) = delete;

    /// What hinders a connection to each of them, in their order, as net::why_unreached(). Nothing
    /// as long as that is looked into.
    [[nodiscard]] std::optional<std::vector<std::string>> hindrances() const;

private:
    const net::Waker waker_;
    mutable std::mutex mutex_;
    std::optional<std::vector<std::string>> hindrances_; // guarded by it
    std::jthread thread_;                                // ends before they go
};

} // namespace fraja::client
