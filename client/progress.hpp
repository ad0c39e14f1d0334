// Progress: how far a job is, in one line; and when the next line is due.
#pragma once

#include "client/remaining.hpp"
#include "common/base/instant.hpp"
#include "common/protocol/messages.hpp"

#include <cstdint>
#include <deque>
#include <optional>
#include <string>

namespace fraja::client {

struct ProgressView {
    JobId job;
    std::string job_name;
    std::uint32_t number = 0;
    protocol::JobPhase phase{};
    std::uint32_t done_count = 0, cell_count = 0;
    double share = 0; ///< share_done()
    std::uint32_t worker_count = 0;
    double rays_per_s = 0; ///< 0: not known
    Duration elapsed{};
    std::optional<Duration> remaining;
    bool connected = true;

    [[nodiscard]] unsigned percent() const { return percent_of(share); }
    /// Rounded down, so that 100 is the end; but 0.29 is 29.
    [[nodiscard]] static unsigned percent_of(double share) {
        return static_cast<unsigned>(100 * share + 1e-9);
    }
};

/// How much of a job is done, from 0 to 1: of its tiles, or of its time where that is limited.
[[nodiscard]] double share_done(const protocol::JobState& state);

/// `cone #17  63%  12 workers  38.1 Mray/s  0:42 < 0:25`
[[nodiscard]] std::string progress_line(const ProgressView& view);

/// So much more of it each second, as it goes now; 0: not known, or it stands still.
[[nodiscard]] double share_per_s(const protocol::JobState& state);

/// "38.1 Mray/s": three digits and a prefix.
[[nodiscard]] std::string format_rate(double rays_per_s);
/// "  38.1 Mray/s  0:42 < 0:25": the end of a line, as far as these are known.
[[nodiscard]] std::string format_pace(double rays_per_s, Duration elapsed,
                                      std::optional<Duration> remaining);

/// How many rays a second were traced of late.
class RateMeter {
public:
    /// Both grow.
    void update(Duration elapsed, std::uint64_t rays);
    /// 0: not known.
    [[nodiscard]] double rays_per_s() const;
    /// From the beginning on.
    [[nodiscard]] double mean_rays_per_s() const;
    /// Whether it goes on from what was told last.
    [[nodiscard]] bool goes_on(Duration elapsed, std::uint64_t rays) const;

private:
    struct Sample {
        Duration elapsed{};
        std::uint64_t rays = 0;
    };
    [[nodiscard]] double since(const Sample& first) const;
    std::deque<Sample> samples_; ///< of the last seconds
};

/// Derives speed and remaining time from the states of one job. The broker's clock counts
/// (JobState::elapsed), so a late reader sees the same.
class ProgressMeter {
public:
    void update(const protocol::JobState& state);
    void set_connected(bool connected) { view_.connected = connected; }
    [[nodiscard]] const ProgressView& view() const { return view_; }

private:
    ProgressView view_;
    RateMeter rate_;
    Remaining remaining_;
};

/// Off a terminal: a line each time another 10 % are reached, and every 30 s.
class PlainPace {
public:
    explicit PlainPace(Instant start) : said_(start) {}
    /// Whether a line is due now; then it counts as said.
    [[nodiscard]] bool is_due(Instant now, unsigned percent);
    [[nodiscard]] Instant next_deadline() const;

private:
    Instant said_;
    unsigned tens_ = 0;
};

} // namespace fraja::client
