// Bytes and shared, immutable blobs of them.
#pragma once

#include <cstddef>
#include <cstring>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

namespace fraja {

using Bytes = std::vector<std::byte>;

/// Immutable bytes with shared ownership: pixels and chunks of scenes on their way through a
/// program. Never null where a message carries one.
using Blob = std::shared_ptr<const Bytes>;

[[nodiscard]] inline Bytes to_bytes(std::string_view text) {
    Bytes bytes(text.size());
    if (!text.empty())
        std::memcpy(bytes.data(), text.data(), text.size());
    return bytes;
}

/// The bytes read as characters; valid as long as `bytes` is.
[[nodiscard]] inline std::string_view as_text(std::span<const std::byte> bytes) {
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

[[nodiscard]] inline Blob make_blob(Bytes bytes) {
    return std::make_shared<const Bytes>(std::move(bytes));
}

} // namespace fraja
