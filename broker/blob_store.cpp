#include "broker/blob_store.hpp"

#include "common/base/assert.hpp"
#include "common/protocol/content_hash.hpp"
#include "common/protocol/limits.hpp"

#include <algorithm>
#include <string>
#include <utility>

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

void BlobStore::restore(const ContentHash& hash, Blob bytes) {
    Entry& entry = entries_.at(hash);
    FRAJA_ASSERT(bytes.size() == entry.total_bytes);
    entry.data.clear();
    entry.whole = std::move(bytes);
}

std::optional<Blob> BlobStore::whole(const ContentHash& hash) const {
    const auto found = entries_.find(hash);
    return found == entries_.end() ? std::nullopt : found->second.whole;
}

std::uint64_t BlobStore::wanted_offset(const ContentHash& hash) const {
    const auto found = entries_.find(hash);
    return found == entries_.end() ? 0 : found->second.data.size();
}

BlobStore::Arrival BlobStore::add(const protocol::Chunk& chunk) {
    const auto found = entries_.find(chunk.blob);
    if (found == entries_.end() || found->second.whole)
        return Arrival::ignored;
    Entry& entry = found->second;
    const Blob& bytes = chunk.blobs.front();
    const std::uint64_t rest = entry.total_bytes - entry.data.size();
    if (chunk.offset_bytes != entry.data.size() || chunk.total_bytes != entry.total_bytes ||
        bytes.size() != std::min<std::uint64_t>(protocol::chunk_bytes, rest))
        return Arrival::ignored;
    entry.data.insert(entry.data.end(), bytes.begin(), bytes.end());
    if (entry.data.size() < entry.total_bytes)
        return Arrival::more;
    if (protocol::content_hash(entry.data) != chunk.blob) {
        entry.data.clear();
        return Arrival::wrong_hash;
    }
    entry.whole = Blob(std::exchange(entry.data, {}));
    return Arrival::complete;
}

std::optional<protocol::Chunk> BlobStore::chunk(const ContentHash& hash,
                                                std::uint64_t offset_bytes) const {
    const auto data = whole(hash);
    if (!data || offset_bytes % protocol::chunk_bytes != 0 || offset_bytes >= data->size())
        return std::nullopt;
    const auto size = std::min<std::uint64_t>(protocol::chunk_bytes, data->size() - offset_bytes);
    // A copy: one that waits for a worker that takes nothing must not keep the whole scene, which
    // may be released meanwhile.
    return protocol::Chunk{.blob = hash,
                           .offset_bytes = offset_bytes,
                           .total_bytes = data->size(),
                           .blobs = {Blob::copy(data->part(offset_bytes, size))}};
}

} // namespace fraja::broker
