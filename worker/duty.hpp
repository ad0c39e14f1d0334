// Duty: when a worker serves, and when it has served enough.
#pragma once

#include "common/base/allowance.hpp"
#include "common/base/instant.hpp"
#include "worker/options.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace fraja::worker {

/// Of each day, by the machine's own clock; over midnight where the end comes first.
struct Hours {
    std::uint32_t begin_min = 0, end_min = 0; ///< minutes of the day; the end is not in it
    [[nodiscard]] bool contains(std::uint32_t minute) const;
    friend bool operator==(const Hours&, const Hours&) = default;
};

/// "20:00-08:00" and nothing else; not from a time to itself.
[[nodiscard]] std::optional<Hours> parse_hours(std::string_view text);
/// "20:00"
[[nodiscard]] std::string time_of_day(std::uint32_t minute);
/// 0..1439, by the machine's clock and time zone.
[[nodiscard]] std::uint32_t minute_now();

struct DutyTerms {
    std::optional<Duration> idle_exit; ///< without any tile for so long is enough
    bool once = false;                 ///< enough when its first work is over
    std::uint64_t memory_max = 0;      ///< bytes that it may grow to; 0: no limit
};

struct MemoryShare {
    std::uint64_t bytes = 0; ///< that it may have; 0: no limit is known
    std::string warning;     ///< for people; empty: all is well
    friend bool operator==(const MemoryShare&, const MemoryShare&) = default;
};

/// By its own limit (0: none) and its control groups'. Where the latter is not above the former,
/// the system ends it before it can leave by itself.
[[nodiscard]] MemoryShare memory_share(std::uint64_t memory_max,
                                       const std::optional<GroupLimit>& group);

/// Looks on while a worker serves.
class Duty {
public:
    /// With --once: after the last tile so long, as more may be on their way.
    static constexpr Duration once_pause = std::chrono::seconds(5);

    explicit Duty(const DutyTerms& terms) : terms_(terms) {}

    enum class Verdict : std::uint8_t {
        go_on,
        enough,
        too_large, ///< it should be started again
    };
    /// To be asked about once a second. `resident_bytes`: of the process, where
    /// there is a limit.
    [[nodiscard]] Verdict judge(Instant now, const Load& load, std::uint64_t resident_bytes);

private:
    DutyTerms terms_;
    std::optional<Instant> idle_since_; ///< nothing: it had work when it was last looked at
    std::uint64_t answers_ = 0;
};

} // namespace fraja::worker
