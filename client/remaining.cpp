#include "client/remaining.hpp"

#include <algorithm>
#include <cmath>

namespace fraja::client {
namespace {

using namespace std::chrono_literals;

constexpr Duration first_moment = 1s;   // the pace of the first tiles may be anything
constexpr Duration standing_still = 3s; // then nobody knows when it goes on

/// Over so long the pace is smoothed: tiles come and go, and other jobs have their turns. Where a
/// film's machines go from frame to frame, nothing is known of the pace for a moment.
Duration smoothing(Duration elapsed, Remaining::Of what) {
    return what == Remaining::Of::film ? std::clamp<Duration>(elapsed / 5, 1s, 60s)
                                       : std::clamp<Duration>(elapsed / 20, 250ms, 20s);
}

} // namespace

void Remaining::update(Duration elapsed, double share, double share_per_s) {
    elapsed_ = elapsed;
    share_ = share;
    if (share <= 0 && share_per_s <= 0)
        begun_at_ = elapsed;
    if (share_per_s <= 0) {
        if (elapsed - paced_at_ > standing_still)
            pace_ = 0;
        return;
    }
    const double old =
        pace_ > 0 ? std::exp(-seconds(elapsed - paced_at_) / seconds(smoothing(elapsed, what_)))
                  : 0;
    // By factors: at first, when nobody knows how much it is, the pace may be many times too high.
    pace_ = old > 0 ? std::pow(pace_, old) * std::pow(share_per_s, 1 - old) : share_per_s;
    paced_at_ = elapsed;
}

std::optional<Duration> Remaining::left() const {
    if (pace_ <= 0 || elapsed_ - begun_at_ < first_moment)
        return std::nullopt;
    return from_seconds((1 - share_) / pace_);
}

} // namespace fraja::client
