#include "common/protocol/content_hash.hpp"

#include "common/base/assert.hpp"

#include <sodium.h>

namespace fraja::protocol {

struct ContentHasher::State {
    crypto_generichash_state blake;
};

ContentHasher::ContentHasher() : state_(std::make_unique<State>()) {
    static const bool ready = sodium_init() >= 0;
    FRAJA_ASSERT(ready);
    crypto_generichash_init(&state_->blake, nullptr, 0, ContentHash{}.bytes.size());
}
ContentHasher::~ContentHasher() = default;
ContentHasher::ContentHasher(ContentHasher&&) noexcept = default;
ContentHasher& ContentHasher::operator=(ContentHasher&&) noexcept = default;

void ContentHasher::add(std::span<const std::byte> piece) {
    crypto_generichash_update(&state_->blake, reinterpret_cast<const unsigned char*>(piece.data()),
                              piece.size());
}

ContentHash ContentHasher::finish() {
    ContentHash hash;
    crypto_generichash_final(&state_->blake, hash.bytes.data(), hash.bytes.size());
    return hash;
}

ContentHash content_hash(std::span<const std::byte> bytes) {
    ContentHasher hasher;
    hasher.add(bytes);
    return hasher.finish();
}

} // namespace fraja::protocol
