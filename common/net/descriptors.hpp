// File descriptors: every socket takes some.
#pragma once

#include "common/base/result.hpp"

#include <cstddef>

namespace fraja::net {

/// Makes sure that this process may have so many sockets with a connection each, beside what
/// programs open otherwise: raises the soft limit where the hard one lets it. The error
/// (limit_exceeded) names the limit.
[[nodiscard]] Result<void> reserve_descriptors(std::size_t sockets);

/// The same for connections to sockets that are bound, but with what can be had: returns how many
/// there is room for, at most `wanted`.
[[nodiscard]] std::size_t reserve_connections(std::size_t wanted);

} // namespace fraja::net
