// The scenes a broker holds, by content hash: arriving chunk by chunk, kept while a job needs them.
#pragma once

#include "common/base/bytes.hpp"
#include "common/base/ids.hpp"
#include "common/base/result.hpp"
#include "common/protocol/content_hash.hpp"
#include "common/protocol/messages.hpp"

#include <cstdint>
#include <map>
#include <optional>
#include <vector>

namespace fraja::broker {

class BlobStore {
public:
    explicit BlobStore(std::uint64_t bytes_max) : bytes_max_(bytes_max) {}

    /// What the blob would take up in addition: nothing, if it is known. invalid_argument when it
    /// is known with another size.
    [[nodiscard]] Result<std::uint64_t> bytes_more(const ContentHash& hash,
                                                   std::uint64_t total_bytes) const;
    /// How many have acquired it.
    [[nodiscard]] std::uint32_t users(const ContentHash& hash) const;
    /// A job needs the blob: it is kept until as many `release` follow. limit_exceeded when it
    /// would not fit; invalid_argument when it is known with another size.
    [[nodiscard]] Result<void> acquire(const ContentHash& hash, std::uint64_t total_bytes);
    void release(const ContentHash& hash);

    /// Gives a blob that was kept elsewhere, and has been acquired, its bytes, which must be right.
    void restore(const ContentHash& hash, const Blob& bytes);

    [[nodiscard]] bool complete(const ContentHash& hash) const;
    /// All of a complete blob, in chunks.
    [[nodiscard]] const std::vector<Blob>& chunks(const ContentHash& hash) const;
    /// The first byte that is still to come.
    [[nodiscard]] std::uint64_t wanted_offset(const ContentHash& hash) const;

    enum class Arrival { more, complete, ignored, wrong_hash };
    /// Takes the chunk at wanted_offset; any other, and one nobody needs, is ignored. A blob that
    /// turns out to have another hash starts again from nothing.
    Arrival add(const protocol::Chunk& chunk);

    /// The chunk of a complete blob that starts at the offset; nothing when there is no such chunk.
    /// Whoever asks for it gets the same bytes in memory, so it costs nothing that many do.
    [[nodiscard]] std::optional<protocol::Chunk> chunk(const ContentHash& hash,
                                                       std::uint64_t offset_bytes) const;

    [[nodiscard]] std::uint64_t bytes() const { return bytes_; }

private:
    struct Entry {
        std::uint64_t total_bytes = 0;
        std::uint32_t users = 0;
        std::vector<Blob> chunks; ///< as far as they have arrived
        std::uint64_t arrived_bytes = 0;
        protocol::ContentHasher hasher; ///< of these
        bool complete = false;
    };
    std::map<ContentHash, Entry> entries_;
    std::uint64_t bytes_max_;
    std::uint64_t bytes_ = 0; ///< of all entries, arrived or announced
};

} // namespace fraja::broker
