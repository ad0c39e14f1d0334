// The real clock: shells read it and hand the time to their cores.
#pragma once

#include "common/base/instant.hpp"

namespace fraja::net {

/// Monotonic, not touched by changes of the wall clock.
[[nodiscard]] Instant now();

/// That this process has used so far, in all its threads.
[[nodiscard]] Duration processor_time();

} // namespace fraja::net
