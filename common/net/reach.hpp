// Whether a host can be reached at all, before anybody speaks ZeroMQ to it.
#pragma once

#include "common/base/instant.hpp"
#include "common/base/result.hpp"

#include <cstdint>
#include <string>

namespace fraja::net {

/// How long a TCP connection to that port took, to the first of the host's addresses that takes
/// one; it is closed again. `host` as in Endpoint. Waits for each address as long as `patience`;
/// looking up a name may take some seconds more. Errors: not_found (no such host), unreachable
/// (refused, no way there, no answer), in words for a person.
[[nodiscard]] Result<Duration> reach(const std::string& host, std::uint16_t port,
                                     Duration patience);

} // namespace fraja::net
