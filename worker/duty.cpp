#include "worker/duty.hpp"

#include "common/base/text.hpp"

#include <algorithm>
#include <ctime>
#include <fmt/core.h>

namespace fraja::worker {
namespace {

constexpr std::uint32_t minutes_per_hour = 60, hours_per_day = 24;

/// "20:00" as minutes of the day.
std::optional<std::uint32_t> parse_time(std::string_view text) {
    const std::size_t colon = text.find(':');
    if (colon == std::string_view::npos || text.size() - colon != 3)
        return std::nullopt;
    const auto hour = parse_count(text.substr(0, colon));
    const auto minute = parse_count(text.substr(colon + 1));
    if (!hour || *hour >= hours_per_day || !minute || *minute >= minutes_per_hour)
        return std::nullopt;
    return static_cast<std::uint32_t>(*hour * minutes_per_hour + *minute);
}

} // namespace

bool Hours::contains(std::uint32_t minute) const {
    return begin_min < end_min ? begin_min <= minute && minute < end_min
                               : begin_min <= minute || minute < end_min;
}

std::optional<Hours> parse_hours(std::string_view text) {
    const std::size_t dash = text.find('-');
    if (dash == std::string_view::npos)
        return std::nullopt;
    const auto begin = parse_time(text.substr(0, dash)), end = parse_time(text.substr(dash + 1));
    if (!begin || !end || *begin == *end)
        return std::nullopt;
    return Hours{*begin, *end};
}

std::string time_of_day(std::uint32_t minute) {
    return fmt::format("{:02}:{:02}", minute / minutes_per_hour, minute % minutes_per_hour);
}

std::uint32_t minute_now() {
    const std::time_t now = std::time(nullptr);
    std::tm local{};
    localtime_r(&now, &local);
    return static_cast<std::uint32_t>(local.tm_hour) * minutes_per_hour +
           static_cast<std::uint32_t>(local.tm_min);
}

MemoryShare memory_share(std::uint64_t memory_max, const std::optional<GroupLimit>& group) {
    const auto bytes = group ? static_cast<std::uint64_t>(group->amount) : 0;
    if (memory_max == 0 || bytes == 0)
        return {std::max(memory_max, bytes), {}};
    if (memory_max < bytes)
        return {memory_max, {}};
    return {bytes, fmt::format("--max-memory of {} MiB: {} lets it have {} MiB, beyond which the "
                               "system ends it before it can leave by itself; give less",
                               memory_max >> 20, group->file, bytes >> 20)};
}

Duty::Verdict Duty::judge(Instant now, const Load& load, std::uint64_t resident_bytes) {
    if (terms_.memory_max > 0 && resident_bytes > terms_.memory_max)
        return Verdict::too_large;
    if (load.busy || load.answers > answers_)
        idle_since_.reset();
    else if (!idle_since_)
        idle_since_ = now;
    answers_ = load.answers;
    if (!idle_since_)
        return Verdict::go_on;
    const Duration idle = now - *idle_since_;
    const bool idle_long = terms_.idle_exit && idle >= *terms_.idle_exit;
    const bool served = terms_.once && answers_ > 0 && idle >= once_pause;
    return idle_long || served ? Verdict::enough : Verdict::go_on;
}

} // namespace fraja::worker
