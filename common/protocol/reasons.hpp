// Reasons that programs look at; all others are for people alone.
#pragma once

#include <string_view>

namespace fraja::protocol {

/// JobState::reason of a job that nobody could be given a tile of.
inline constexpr std::string_view no_worker_reason = "waiting: no worker is connected";

} // namespace fraja::protocol
