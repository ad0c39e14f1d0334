// The name of bytes: BLAKE2b-256 (RFC 7693), from libsodium.
#pragma once

#include "common/base/ids.hpp"

#include <cstddef>
#include <memory>
#include <span>

namespace fraja::protocol {

[[nodiscard]] ContentHash content_hash(std::span<const std::byte> bytes);

/// The same of bytes that come piece by piece.
class ContentHasher {
public:
    ContentHasher();
    ~ContentHasher();
    ContentHasher(ContentHasher&&) noexcept;
    ContentHasher& operator=(ContentHasher&&) noexcept;

    void add(std::span<const std::byte> piece);
    /// Of all that was added. Once only.
    [[nodiscard]] ContentHash finish();

private:
    struct State;
    std::unique_ptr<State> state_;
};

} // namespace fraja::protocol
