// Time as the cores see it: it arrives with every event, and no core has a clock of its own.
#pragma once

#include <chrono>
#include <compare>

namespace fraja {

using Duration = std::chrono::nanoseconds;

/// A point on a monotonic clock whose zero has no meaning. Only differences count.
struct Instant {
    Duration since_start{};
    friend auto operator<=>(const Instant&, const Instant&) = default;
    friend Instant operator+(Instant a, Duration d) { return {a.since_start + d}; }
    friend Instant operator-(Instant a, Duration d) { return {a.since_start - d}; }
    friend Duration operator-(Instant a, Instant b) { return a.since_start - b.since_start; }
    /// Later than everything: "no deadline".
    static constexpr Instant never() { return {Duration::max()}; }
};

[[nodiscard]] inline double seconds(Duration d) {
    return std::chrono::duration<double>(d).count();
}
/// Rounded towards zero; beyond what a Duration holds (292 years) the largest, or the smallest. NaN
/// is the largest.
[[nodiscard]] inline Duration from_seconds(double s) {
    constexpr double largest_s = 9'223'372'036; // below 2^63 nanoseconds
    if (!(s < largest_s))
        return Duration::max();
    if (s < -largest_s)
        return Duration::min();
    return std::chrono::duration_cast<Duration>(std::chrono::duration<double>(s));
}

} // namespace fraja
