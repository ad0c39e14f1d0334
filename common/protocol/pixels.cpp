#include "common/protocol/pixels.hpp"

#include "common/base/assert.hpp"
#include "common/protocol/limits.hpp"

#include <bit>
#include <cstring>
#include <utility>

namespace fraja::protocol {

static_assert(std::endian::native == std::endian::little, "pixels travel little-endian");

std::vector<float> floats_of(const std::vector<Blob>& blobs) {
    const Blob bytes = joined(blobs);
    std::vector<float> floats(bytes.size() / sizeof(float));
    if (!floats.empty())
        std::memcpy(floats.data(), bytes.data(), floats.size() * sizeof(float));
    return floats;
}

PixelPlanes::PixelPlanes(const PixelRect& area, std::uint64_t pixel_bytes)
    : area_(area), pixel_bytes_(pixel_bytes), bytes_(area.pixel_count() * pixel_bytes) {
    FRAJA_ASSERT(pixel_bytes >= colour_bytes && (pixel_bytes - colour_bytes) % plane_bytes == 0);
}

template <class F>
void PixelPlanes::for_each_row(const PixelRect& part, F deed) const {
    FRAJA_ASSERT(part.inside(area_));
    std::size_t plane_begin = 0, there = 0;
    for (std::uint64_t done = 0; done < pixel_bytes_;) {
        const std::uint64_t size = done == 0 ? colour_bytes : plane_bytes;
        for (std::uint32_t row = 0; row < part.height; ++row) {
            const std::size_t pixel =
                std::size_t{part.y - area_.y + row} * area_.width + (part.x - area_.x);
            deed(plane_begin + pixel * size, there, part.width * size);
            there += part.width * size;
        }
        plane_begin += area_.pixel_count() * size;
        done += size;
    }
}

void PixelPlanes::place(const PixelRect& part, const std::vector<Blob>& blobs) {
    const Blob whole = joined(blobs);
    FRAJA_ASSERT(whole.size() == part.pixel_count() * pixel_bytes_);
    for_each_row(part, [&](std::size_t here, std::size_t there, std::size_t size) {
        std::memcpy(bytes_.data() + here, whole.data() + there, size);
    });
}

std::vector<Blob> PixelPlanes::blobs(const PixelRect& part) const {
    Bytes all(part.pixel_count() * pixel_bytes_);
    for_each_row(part, [&](std::size_t here, std::size_t there, std::size_t size) {
        std::memcpy(all.data() + there, bytes_.data() + here, size);
    });
    return cut(Blob(std::move(all)), chunk_bytes);
}

} // namespace fraja::protocol
