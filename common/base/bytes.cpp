#include "common/base/bytes.hpp"

namespace fraja {

std::size_t byte_count(std::span<const Blob> blobs) {
    std::size_t bytes = 0;
    for (const Blob& blob : blobs)
        bytes += blob.size();
    return bytes;
}

Blob joined(std::span<const Blob> blobs) {
    if (blobs.size() == 1)
        return blobs.front();
    Bytes all;
    all.reserve(byte_count(blobs));
    for (const Blob& blob : blobs)
        all.insert(all.end(), blob.begin(), blob.end());
    return Blob(std::move(all));
}

std::vector<Blob> cut(const Blob& whole, std::size_t part_bytes) {
    FRAJA_ASSERT(part_bytes > 0);
    std::vector<Blob> parts;
    std::size_t begin = 0;
    do {
        parts.push_back(whole.part(begin, std::min(part_bytes, whole.size() - begin)));
        begin += part_bytes;
    } while (begin < whole.size());
    return parts;
}

} // namespace fraja
