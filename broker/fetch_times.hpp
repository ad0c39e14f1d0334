// FetchTimes: what is known of how long a worker that is new to a scene needs before it draws.
#pragma once

#include "common/base/ids.hpp"
#include "common/base/instant.hpp"

#include <cstddef>
#include <deque>
#include <map>

namespace fraja::broker {

/// Of each scene a mean in which the last ones count most: a worker that has come back with the
/// scene still at hand tells little, as does one that was stopped meanwhile.
class FetchTimes {
public:
    /// Of so many scenes; the oldest are forgotten first.
    explicit FetchTimes(std::size_t scenes_max) : scenes_max_(scenes_max) {}

    void add(const ContentHash& scene, Duration time) {
        const auto [at, is_new] = times_.try_emplace(scene, time);
        if (!is_new)
            at->second += (time - at->second) / 4;
        else
            in_order_.push_back(scene);
        if (in_order_.size() > scenes_max_) {
            times_.erase(in_order_.front());
            in_order_.pop_front();
        }
    }
    /// None, as long as nobody has fetched it.
    [[nodiscard]] Duration of(const ContentHash& scene) const {
        const auto found = times_.find(scene);
        return found == times_.end() ? Duration::zero() : found->second;
    }

private:
    std::size_t scenes_max_;
    std::map<ContentHash, Duration> times_;
    std::deque<ContentHash> in_order_;
};

} // namespace fraja::broker
