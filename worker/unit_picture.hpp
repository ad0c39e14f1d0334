// UnitPicture: a picture that was drawn once, from which any tile's answer is put together.
#pragma once

#include "common/base/bytes.hpp"
#include "common/base/pixel_rect.hpp"
#include "common/protocol/messages.hpp"
#include "common/protocol/pixels.hpp"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace fraja::worker {

/// Pixels as they travel, and what they cost, by units: squares of a grid from the picture's top
/// left (less at the area's borders), row by row.
class UnitPicture {
public:
    static constexpr std::uint32_t side_max = 32;

    struct Shape {
        PixelRect area; ///< of the picture; not empty
        std::uint32_t unit_side = 1;
        std::uint64_t pixel_bytes = 12; ///< 12 for the colours, and 4 for each further plane

        [[nodiscard]] std::uint64_t unit_count() const {
            return cells_of(area, unit_side).pixel_count();
        }
        [[nodiscard]] std::uint64_t memory_bytes() const {
            return area.pixel_count() * pixel_bytes + unit_count() * sizeof(protocol::Rays);
        }
        friend bool operator==(const Shape&, const Shape&) = default;
    };
    /// Black, and free of charge.
    explicit UnitPicture(const Shape& shape);

    [[nodiscard]] const Shape& shape() const { return shape_; }
    [[nodiscard]] PixelRect unit(std::uint64_t index) const;
    /// `blobs` are the unit's as of pixel_blobs (their size is asserted).
    void place(std::uint64_t index, const std::vector<Blob>& blobs, const protocol::Rays& rays);

    /// `rect` lies within the area. What pixel_blobs gives for that tile.
    [[nodiscard]] std::vector<Blob> blobs(const PixelRect& rect) const {
        return pixels_.blobs(rect);
    }
    /// Of units that lie in it in part, as large a part.
    [[nodiscard]] protocol::Rays rays(const PixelRect& rect) const;
    /// All of the unit in which the rect begins.
    [[nodiscard]] const protocol::Rays& rays_of_unit(const PixelRect& rect) const;

private:
    Shape shape_;
    protocol::PixelPlanes pixels_;
    std::vector<protocol::Rays> rays_;
};

} // namespace fraja::worker
