// Remaining: how long a job will still take, from how it goes.
#pragma once

#include "common/base/instant.hpp"

#include <cstdint>
#include <optional>

namespace fraja::client {

/// What is left, at the pace of the last moments: the broker knows how much its farm does of the
/// job, also when workers have come or gone, and whenever somebody begins to look.
class Remaining {
public:
    enum class Of : std::uint8_t { job, film };
    explicit Remaining(Of what = Of::job) : what_(what) {}
    /// `share` of the job is done, 0 to 1, at `elapsed`, which grows; and so much more of it each
    /// second, 0 where that is not known. Forget an earlier job by another Remaining.
    void update(Duration elapsed, double share, double share_per_s);
    /// Nothing as long as nothing can be said, as of a job that has been drawn for less than a
    /// second; nor of one that has stood still for a while.
    [[nodiscard]] std::optional<Duration> left() const;

private:
    Of what_;
    Duration elapsed_{};
    Duration begun_at_{}; ///< until then nothing was drawn
    Duration paced_at_{}; ///< when there was a pace
    double share_ = 0;
    double pace_ = 0; ///< share per second, smoothed; 0: not known
};

} // namespace fraja::client
