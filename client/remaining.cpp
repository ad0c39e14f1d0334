#include "client/remaining.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

namespace fraja::client {
namespace {

using namespace std::chrono_literals;

constexpr double under_way_share = 0.01;
constexpr Duration known_after = 1s;        // by the mean, until there is a line
constexpr Duration line_length_min = 2s;    // that says more than the mean
constexpr double workers_change_min = 0.25; // of them, that makes it another farm,
constexpr Duration change_length_min = 2s;  // unless they are soon back

} // namespace

void Remaining::Line::add(double time, double done) {
    n += 1;
    t += time;
    s += done;
    tt += time * time;
    ts += time * done;
}

double Remaining::Line::slope() const {
    const double spread = n * tt - t * t;
    return spread > 0 ? std::max(0.0, (n * ts - t * s) / spread) : 0;
}

bool Remaining::is_another_farm(Duration elapsed, std::uint32_t worker_count) {
    const double before = line_->workers, change = std::abs(worker_count - before);
    if (worker_count == 0 || change <= workers_change_min * before) {
        other_since_.reset();
        return false;
    }
    if (!other_since_)
        other_since_ = elapsed;
    return elapsed - *other_since_ >= change_length_min;
}

void Remaining::update(Duration elapsed, double share, std::uint32_t worker_count) {
    elapsed_ = elapsed;
    share_ = share;
    if (share <= 0)
        idle_ = elapsed;
    if (share < under_way_share)
        return;
    if (!line_ || is_another_farm(elapsed, worker_count))
        line_ = Line{.begin = elapsed, .share = share, .workers = worker_count};
    line_->add(seconds(elapsed - line_->begin), share - line_->share);
    if (elapsed - line_->begin >= std::max<Duration>(line_length_min, idle_ / 2))
        slope_ = line_->slope();
}

std::optional<Duration> Remaining::left() const {
    if (share_ <= 0 || elapsed_ < known_after)
        return std::nullopt;
    // The first tiles come together: soon after them the mean of all the time tells more.
    const Duration working = elapsed_ - idle_;
    const bool well_under_way = working >= std::max<Duration>(known_after, idle_ / 2);
    const double mean = share_ / seconds(well_under_way ? working : elapsed_);
    return from_seconds((1 - share_) / (slope_ > 0 ? slope_ : mean));
}

} // namespace fraja::client
