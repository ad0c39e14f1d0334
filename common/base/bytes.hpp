// Bytes and shared, immutable blobs of them.
#pragma once

#include "common/base/assert.hpp"

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <memory>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

namespace fraja {

using Bytes = std::vector<std::byte>;

/// Immutable bytes with shared ownership: pixels and chunks of scenes on their way through a
/// program. A copy is the same bytes in memory; whoever holds one may read it in any thread.
class Blob {
public:
    Blob() = default; ///< empty
    explicit Blob(Bytes bytes) {
        auto owner = std::make_shared<const Bytes>(std::move(bytes));
        bytes_ = *owner;
        owner_ = std::move(owner);
    }
    /// Bytes that something else than a vector holds, for as long as `owner` lives.
    Blob(std::shared_ptr<const void> owner, std::span<const std::byte> bytes)
        : owner_(std::move(owner)), bytes_(bytes) {}

    [[nodiscard]] static Blob copy(std::span<const std::byte> bytes) {
        return Blob(Bytes(bytes.begin(), bytes.end()));
    }

    /// So many of these bytes, not copied: a part keeps the whole in memory. They must be there
    /// (asserted).
    [[nodiscard]] Blob part(std::size_t begin, std::size_t size) const {
        FRAJA_ASSERT(begin <= bytes_.size() && size <= bytes_.size() - begin);
        return {owner_, bytes_.subspan(begin, size)};
    }

    [[nodiscard]] const std::byte* data() const { return bytes_.data(); }
    [[nodiscard]] std::size_t size() const { return bytes_.size(); }
    [[nodiscard]] bool empty() const { return bytes_.empty(); }
    // Contiguous: a Blob converts to a span.
    [[nodiscard]] const std::byte* begin() const { return data(); }
    [[nodiscard]] const std::byte* end() const { return data() + size(); }

    friend bool operator==(const Blob& a, const Blob& b) { return std::ranges::equal(a, b); }

private:
    std::shared_ptr<const void> owner_;
    std::span<const std::byte> bytes_;
};

/// The sizes of all of them.
[[nodiscard]] std::size_t byte_count(std::span<const Blob> blobs);
/// All of them one after the other; of a single one the same bytes, not copied.
[[nodiscard]] Blob joined(std::span<const Blob> blobs);
/// Blob::part()s of `part_bytes` (more than none, asserted), and one of what is left: at least one.
[[nodiscard]] std::vector<Blob> cut(const Blob& whole, std::size_t part_bytes);

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

} // namespace fraja
