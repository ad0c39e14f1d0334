// The name of bytes: BLAKE2b-256 (RFC 7693), from libsodium.
#pragma once

#include "common/base/ids.hpp"

#include <cstddef>
#include <span>

namespace fraja::protocol {

[[nodiscard]] ContentHash content_hash(std::span<const std::byte> bytes);

} // namespace fraja::protocol
