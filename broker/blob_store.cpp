#include "broker/blob_store.hpp"

#include "common/base/assert.hpp"
#include "common/protocol/limits.hpp"

#include <algorithm>
#include <string>

namespace fraja::broker {

Result<std::uint64_t> BlobStore::bytes_more(const ContentHash& hash,
                                            std::uint64_t total_bytes) const {
    const auto found = entries_.find(hash);
    if (found == entries_.end())
        return total_bytes;
    if (found->second.total_bytes != total_bytes)
        return Error{ErrorCode::invalid_argument, "the scene is known with another size"};
    return std::uint64_t{0};
}

std::uint32_t BlobStore::users(const ContentHash& hash) const {
    const auto found = entries_.find(hash);
    return found == entries_.end() ? 0 : found->second.users;
}

Result<void> BlobStore::acquire(const ContentHash& hash, std::uint64_t total_bytes) {
    const auto more = bytes_more(hash, total_bytes);
    if (!more)
        return more.error();
    if (bytes_ + *more > bytes_max_)
        return Error{ErrorCode::limit_exceeded,
                     "the broker holds scenes of at most " + std::to_string(bytes_max_) + " bytes"};
    bytes_ += *more;
    Entry& entry = entries_[hash];
    entry.total_bytes = total_bytes;
    ++entry.users;
    return {};
}

void BlobStore::release(const ContentHash& hash) {
    const auto found = entries_.find(hash);
    FRAJA_ASSERT(found != entries_.end() && found->second.users > 0);
    if (--found->second.users == 0) {
        bytes_ -= found->second.total_bytes;
        entries_.erase(found);
    }
}

void BlobStore::restore(const ContentHash& hash, const Blob& bytes) {
    Entry& entry = entries_.at(hash);
    FRAJA_ASSERT(bytes.size() == entry.total_bytes);
    entry.chunks = cut(bytes, protocol::chunk_bytes);
    entry.arrived_bytes = entry.total_bytes;
    entry.complete = true;
}

bool BlobStore::complete(const ContentHash& hash) const {
    const auto found = entries_.find(hash);
    return found != entries_.end() && found->second.complete;
}

const std::vector<Blob>& BlobStore::chunks(const ContentHash& hash) const {
    const Entry& entry = entries_.at(hash);
    FRAJA_ASSERT(entry.complete);
    return entry.chunks;
}

std::uint64_t BlobStore::wanted_offset(const ContentHash& hash) const {
    const auto found = entries_.find(hash);
    return found == entries_.end() ? 0 : found->second.arrived_bytes;
}

BlobStore::Arrival BlobStore::add(const protocol::Chunk& chunk) {
    const auto found = entries_.find(chunk.blob);
    if (found == entries_.end() || found->second.complete)
        return Arrival::ignored;
    Entry& entry = found->second;
    const Blob& bytes = chunk.blobs.front();
    const std::uint64_t rest = entry.total_bytes - entry.arrived_bytes;
    if (chunk.offset_bytes != entry.arrived_bytes || chunk.total_bytes != entry.total_bytes ||
        bytes.size() != std::min<std::uint64_t>(protocol::chunk_bytes, rest))
        return Arrival::ignored;
    entry.chunks.push_back(bytes);
    entry.hasher.add(bytes);
    entry.arrived_bytes += bytes.size();
    if (entry.arrived_bytes < entry.total_bytes)
        return Arrival::more;
    if (entry.hasher.finish() != chunk.blob) {
        entry.chunks.clear();
        entry.hasher = {};
        entry.arrived_bytes = 0;
        return Arrival::wrong_hash;
    }
    entry.complete = true;
    return Arrival::complete;
}

std::optional<protocol::Chunk> BlobStore::chunk(const ContentHash& hash,
                                                std::uint64_t offset_bytes) const {
    const std::uint64_t at = offset_bytes / protocol::chunk_bytes;
    if (!complete(hash) || offset_bytes % protocol::chunk_bytes != 0 || at >= chunks(hash).size())
        return std::nullopt;
    return protocol::Chunk{.blob = hash,
                           .offset_bytes = offset_bytes,
                           .total_bytes = entries_.at(hash).total_bytes,
                           .blobs = {chunks(hash)[at]}};
}

} // namespace fraja::broker
