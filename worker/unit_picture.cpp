#include "worker/unit_picture.hpp"

#include "common/base/assert.hpp"
#include "common/protocol/limits.hpp"
#include "common/protocol/pixels.hpp"

#include <algorithm>
#include <cstring>
#include <tuple>
#include <utility>

namespace fraja::worker {
namespace {

using protocol::colour_bytes, protocol::plane_bytes;

PixelRect common_part(const PixelRect& a, const PixelRect& b) {
    const auto along = [](std::uint32_t from_a, std::uint32_t length_a, std::uint32_t from_b,
                          std::uint32_t length_b) {
        const std::uint64_t begin = std::max(from_a, from_b);
        const std::uint64_t end =
            std::min(std::uint64_t{from_a} + length_a, std::uint64_t{from_b} + length_b);
        return std::pair(static_cast<std::uint32_t>(begin),
                         static_cast<std::uint32_t>(end > begin ? end - begin : 0));
    };
    const auto [x, width] = along(a.x, a.width, b.x, b.width);
    const auto [y, height] = along(a.y, a.height, b.y, b.height);
    return {x, y, width, height};
}

/// Of the unit `whole`, the part's pixels: each has as many as the others, as far as whole numbers
/// allow, so that the parts' sum is the whole's.
protocol::Rays share_of(const protocol::Rays& rays, const PixelRect& whole, const PixelRect& part) {
    protocol::Rays share;
    const std::uint64_t pixels = whole.pixel_count();
    const auto up_to = [pixels](std::uint64_t count, std::uint64_t pixel) {
        return count / pixels * pixel + count % pixels * pixel / pixels;
    };
    for (std::uint32_t y = part.y; y < part.y + part.height; ++y) {
        const std::uint64_t first = std::uint64_t{y - whole.y} * whole.width + (part.x - whole.x);
        std::apply(
            [&](const auto&... field) {
                ((share.*field.member +=
                  up_to(rays.*field.member, first + part.width) - up_to(rays.*field.member, first)),
                 ...);
            },
            protocol::Rays::fields());
    }
    return share;
}

} // namespace

UnitPicture::UnitPicture(const Shape& shape)
    : shape_(shape), bytes_(shape.area.pixel_count() * shape.pixel_bytes),
      rays_(shape.unit_count()) {
    FRAJA_ASSERT(shape.unit_side > 0 && shape.unit_side <= side_max);
    FRAJA_ASSERT(shape.pixel_bytes >= colour_bytes);
}

PixelRect UnitPicture::unit(std::uint64_t index) const {
    const std::uint32_t side = shape_.unit_side;
    const PixelRect cells = cells_of(shape_.area, side);
    const auto column = static_cast<std::uint32_t>(index % cells.width);
    const auto row = static_cast<std::uint32_t>(index / cells.width);
    return common_part({(cells.x + column) * side, (cells.y + row) * side, side, side},
                       shape_.area);
}

template <class F>
void UnitPicture::for_each_row(const PixelRect& rect, F deed) const {
    FRAJA_ASSERT(rect.inside(shape_.area));
    const PixelRect& area = shape_.area;
    std::size_t plane_begin = 0, at = 0;
    for (std::size_t done = 0; done < shape_.pixel_bytes;) {
        const std::size_t size = done == 0 ? colour_bytes : plane_bytes;
        for (std::uint32_t row = 0; row < rect.height; ++row) {
            const std::size_t pixel =
                std::size_t{rect.y - area.y + row} * area.width + (rect.x - area.x);
            deed(plane_begin + pixel * size, at, rect.width * size);
            at += rect.width * size;
        }
        plane_begin += area.pixel_count() * size;
        done += size;
    }
}

void UnitPicture::place(std::uint64_t index, const std::vector<Blob>& blobs,
                        const protocol::Rays& rays) {
    static_assert(std::size_t{side_max} * side_max * 20 <= protocol::chunk_bytes);
    const PixelRect rect = unit(index);
    FRAJA_ASSERT(blobs.size() == 1 && blobs[0]->size() == rect.pixel_count() * shape_.pixel_bytes);
    for_each_row(rect, [&](std::size_t here, std::size_t there, std::size_t size) {
        std::memcpy(bytes_.data() + here, blobs[0]->data() + there, size);
    });
    rays_.at(index) = rays;
}

std::vector<Blob> UnitPicture::blobs(const PixelRect& rect) const {
    Bytes all(rect.pixel_count() * shape_.pixel_bytes);
    for_each_row(rect, [&](std::size_t here, std::size_t there, std::size_t size) {
        std::memcpy(all.data() + there, bytes_.data() + here, size);
    });
    if (all.size() <= protocol::chunk_bytes)
        return {make_blob(std::move(all))};
    std::vector<Blob> blobs;
    for (std::size_t begin = 0; begin < all.size(); begin += protocol::chunk_bytes) {
        const std::size_t end = std::min(begin + protocol::chunk_bytes, all.size());
        blobs.push_back(make_blob(Bytes(all.begin() + static_cast<std::ptrdiff_t>(begin),
                                        all.begin() + static_cast<std::ptrdiff_t>(end))));
    }
    return blobs;
}

const protocol::Rays& UnitPicture::rays_of_unit(const PixelRect& rect) const {
    const PixelRect first = cells_of(shape_.area, shape_.unit_side);
    const std::uint64_t row = rect.y / shape_.unit_side - first.y;
    return rays_.at(row * first.width + (rect.x / shape_.unit_side - first.x));
}

protocol::Rays UnitPicture::rays(const PixelRect& rect) const {
    const PixelRect first = cells_of(shape_.area, shape_.unit_side);
    const PixelRect cells = cells_of(rect, shape_.unit_side);
    protocol::Rays sum;
    for (std::uint32_t row = 0; row < cells.height; ++row)
        for (std::uint32_t column = 0; column < cells.width; ++column) {
            const std::uint64_t index =
                std::uint64_t{cells.y - first.y + row} * first.width + (cells.x - first.x + column);
            const PixelRect whole = unit(index), part = common_part(whole, rect);
            sum += part == whole ? rays_.at(index) : share_of(rays_.at(index), whole, part);
        }
    return sum;
}

} // namespace fraja::worker
