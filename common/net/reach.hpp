// What a person would try first where nobody answers: is there such a host, does anything listen?
#pragma once

#include "common/base/instant.hpp"

#include <string>

namespace fraja::net {

inline constexpr Duration reach_timeout = std::chrono::seconds(1);

/// Why nobody answers at that tcp endpoint: "nothing listens there", "there is no such host".
/// Empty where that cannot be found out, and for other transports. Takes as long as it takes to
/// look a name up, and reach_timeout.
[[nodiscard]] std::string why_silent(const std::string& endpoint);

} // namespace fraja::net
