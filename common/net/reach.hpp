// What a person would try first where nobody answers: is there such a host, does anything listen?
#pragma once

#include "common/base/instant.hpp"
#include "common/base/result.hpp"
#include "common/net/tcp.hpp"

#include <cstdint>
#include <string>

namespace fraja::net {

inline constexpr Duration reach_timeout = std::chrono::seconds(1);

/// How long a TCP connection to that port took, to the first of the host's addresses that takes
/// one; it is closed again. `host` as in Endpoint. Waits for each address as long as reach_timeout;
/// looking up a name may take some seconds more. Errors: not_found (no such host), unreachable
/// (refused, no way there, no answer), cancelled.
[[nodiscard]] Result<Duration> reach(const std::string& host, std::uint16_t port,
                                     const Interrupt& interrupt = {});

/// What hinders a connection to that tcp endpoint: "nothing listens there", "there is no such
/// host". Empty: nothing does, or it is of another transport. Takes as long as reach().
[[nodiscard]] std::string why_unreached(const std::string& endpoint,
                                        const Interrupt& interrupt = {});

/// Why nobody answers at that tcp endpoint: as above, or that who listens there does not. Empty for
/// other transports.
[[nodiscard]] std::string why_silent(const std::string& endpoint);

} // namespace fraja::net
