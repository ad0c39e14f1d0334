// Reasons that programs look at; all others are for people alone.
#pragma once

#include <string_view>

namespace fraja::protocol {

/// JobState::reason of a job while nobody is there who could be given a tile of it.
inline constexpr std::string_view no_worker_reason = "waiting: no worker is connected";
/// So it begins also where some are there, of whom none suits it.
inline constexpr std::string_view no_worker_reasons = "waiting: no worker ";

} // namespace fraja::protocol
