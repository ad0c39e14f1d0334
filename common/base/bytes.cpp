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

} // namespace fraja
