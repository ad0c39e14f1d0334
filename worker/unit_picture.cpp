#include "worker/unit_picture.hpp"

#include "common/base/assert.hpp"

#include <algorithm>
#include <tuple>
#include <utility>

namespace fraja::worker {
namespace {

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
    : shape_(shape), pixels_(shape.area, shape.pixel_bytes), rays_(shape.unit_count()) {
    FRAJA_ASSERT(shape.unit_side > 0 && shape.unit_side <= side_max);
}

PixelRect UnitPicture::unit(std::uint64_t index) const {
    const std::uint32_t side = shape_.unit_side;
    const PixelRect cells = cells_of(shape_.area, side);
    const auto column = static_cast<std::uint32_t>(index % cells.width);
    const auto row = static_cast<std::uint32_t>(index / cells.width);
    return common_part({(cells.x + column) * side, (cells.y + row) * side, side, side},
                       shape_.area);
}

void UnitPicture::place(std::uint64_t index, const std::vector<Blob>& blobs,
                        const protocol::Rays& rays) {
    pixels_.place(unit(index), blobs);
    rays_.at(index) = rays;
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
