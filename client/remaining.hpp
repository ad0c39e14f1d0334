// Remaining: how long a job will still take, from how it went so far.
#pragma once

#include "common/base/instant.hpp"

#include <cstdint>
#include <optional>

namespace fraja::client {

/// The straight line nearest to what was done when (least squares), from where the farm was under
/// way: the time before, in which workers fetch the scene and draw their first tiles, is not to be
/// paid again. Where the number of workers has become quite another, and stays so, a new line
/// begins.
class Remaining {
public:
    /// `share` of the job is done, 0 to 1, at `elapsed`; both grow. Forget an earlier job by
    /// another Remaining.
    void update(Duration elapsed, double share, std::uint32_t worker_count);
    /// Nothing as long as nothing can be said.
    [[nodiscard]] std::optional<Duration> left() const;

private:
    /// Sums of a line's points, in seconds and shares from its first on.
    struct Line {
        Duration begin{};
        double share = 0;
        std::uint32_t workers = 0;
        double n = 0, t = 0, s = 0, tt = 0, ts = 0;

        void add(double time, double done);
        [[nodiscard]] double slope() const; ///< share per second; 0: not known
    };

    [[nodiscard]] bool is_another_farm(Duration elapsed, std::uint32_t worker_count);

    std::optional<Line> line_;
    std::optional<Duration> other_since_; ///< when the workers became other ones than the line's
    double slope_ = 0;                    ///< of the last line that was long enough
    Duration idle_{};                     ///< until when there was nothing
    Duration elapsed_{};
    double share_ = 0;
};

} // namespace fraja::client
