// A number for an id of 16 bytes, the same in every broker.
#pragma once

#include "common/base/rng.hpp"

#include <cstdint>
#include <cstring>

namespace fraja::broker {

template <class Id>
[[nodiscard]] std::uint64_t hash_of(const Id& id) {
    std::uint64_t parts[2];
    static_assert(sizeof(id.bytes) == sizeof(parts));
    std::memcpy(parts, id.bytes.data(), sizeof parts);
    return Rng(parts[0] ^ Rng(parts[1]).next()).next();
}

} // namespace fraja::broker
