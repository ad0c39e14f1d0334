// Once: what is said again and again, said once in a while.
#pragma once

#include "common/base/instant.hpp"

#include <cstddef>
#include <map>
#include <string>

namespace fraja {

/// Remembers a bounded number of things; what comes when it is full is not said at all: it is the
/// counters' matter then, as whoever makes up ever new things wants to fill the log.
class Once {
public:
    Once(Duration interval, std::size_t things_max)
        : interval_(interval), things_max_(things_max) {}

    /// Whether `thing` has not been said within the interval; it then counts as said.
    [[nodiscard]] bool is_new(Instant now, const std::string& thing) {
        const auto found = said_.find(thing);
        if (found != said_.end() && now - found->second < interval_)
            return false;
        if (found == said_.end() && said_.size() >= things_max_)
            std::erase_if(said_, [&](const auto& s) { return now - s.second >= interval_; });
        if (found == said_.end() && said_.size() >= things_max_)
            return false;
        said_[thing] = now;
        return true;
    }
    [[nodiscard]] std::size_t size() const { return said_.size(); }

private:
    Duration interval_;
    std::size_t things_max_;
    std::map<std::string, Instant> said_;
};

} // namespace fraja
