// The real clock: shells read it and hand the time to their cores.
#pragma once

#include "common/base/instant.hpp"

namespace fraja::net {

/// Monotonic, not touched by changes of the wall clock.
[[nodiscard]] Instant now();
/// When this program was started, told by what processor time it has used: for whoever asks before
/// anything else is done. Loading the libraries behind OpenImageIO takes a quarter of a second.
[[nodiscard]] Instant program_start();

} // namespace fraja::net
