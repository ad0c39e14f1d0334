#include "common/protocol/content_hash.hpp"

#include "common/base/assert.hpp"

#include <sodium.h>

namespace fraja::protocol {

ContentHash content_hash(std::span<const std::byte> bytes) {
    static const bool ready = sodium_init() >= 0;
    FRAJA_ASSERT(ready);
    ContentHash hash;
    crypto_generichash(hash.bytes.data(), hash.bytes.size(),
                       reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size(), nullptr,
                       0);
    return hash;
}

} // namespace fraja::protocol
