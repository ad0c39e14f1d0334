#include "common/protocol/pixels.hpp"

#include "common/base/assert.hpp"
#include "common/protocol/limits.hpp"

#include <algorithm>
#include <cstddef>

namespace fraja::protocol {

std::vector<Blob> pixels_of_part(const std::vector<Blob>& blobs, const PixelRect& rect,
                                 const PixelRect& part, std::uint64_t pixel_bytes) {
    FRAJA_ASSERT(part.inside(rect));
    Bytes whole;
    for (const Blob& blob : blobs)
        whole.insert(whole.end(), blob->begin(), blob->end());
    FRAJA_ASSERT(whole.size() == rect.pixel_count() * pixel_bytes);

    Bytes bytes;
    bytes.reserve(part.pixel_count() * pixel_bytes);
    std::uint64_t plane_begin = 0;
    for (std::uint64_t done = 0; done < pixel_bytes;) {
        const std::uint64_t size = done == 0 ? colour_bytes : plane_bytes;
        for (std::uint32_t y = part.y; y < part.y + part.height; ++y) {
            const std::uint64_t first = std::uint64_t{y - rect.y} * rect.width + (part.x - rect.x);
            const auto begin =
                whole.begin() + static_cast<std::ptrdiff_t>(plane_begin + first * size);
            bytes.insert(bytes.end(), begin,
                         begin + static_cast<std::ptrdiff_t>(part.width * size));
        }
        plane_begin += rect.pixel_count() * size;
        done += size;
    }

    std::vector<Blob> cut;
    for (std::size_t begin = 0; begin < bytes.size(); begin += chunk_bytes) {
        const std::size_t end = std::min(begin + chunk_bytes, bytes.size());
        cut.push_back(make_blob(Bytes(bytes.begin() + static_cast<std::ptrdiff_t>(begin),
                                      bytes.begin() + static_cast<std::ptrdiff_t>(end))));
    }
    return cut;
}

} // namespace fraja::protocol
