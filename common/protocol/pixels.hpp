// Pixels as they travel: of each its colour, plane by plane what else there is, cut into frames.
#pragma once

#include "common/base/bytes.hpp"
#include "common/base/pixel_rect.hpp"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace fraja::protocol {

inline constexpr std::uint64_t colour_bytes = 12; ///< of a pixel, in the first plane
inline constexpr std::uint64_t plane_bytes = 4;   ///< of a pixel, in each that follows

/// The floats that the blobs are together, one after the other; one may be cut in two. What makes
/// no whole float at the end is left out.
[[nodiscard]] std::vector<float> floats_of(const std::vector<Blob>& blobs);

/// The pixels of a rectangle, to be put together from parts and to be cut into others.
class PixelPlanes {
public:
    /// Zeros. Of each pixel there are `pixel_bytes`: `colour_bytes`, and `plane_bytes` for each
    /// further plane.
    PixelPlanes(const PixelRect& area, std::uint64_t pixel_bytes);

    [[nodiscard]] const PixelRect& area() const { return area_; }
    /// The part lies within the area, and the blobs are its pixels; both are asserted.
    void place(const PixelRect& part, const std::vector<Blob>& blobs);
    /// A part's pixels, as a tile of its size would have them.
    [[nodiscard]] std::vector<Blob> blobs(const PixelRect& part) const;

private:
    /// Calls deed(offset of a row of `part` here, offset in the part's own bytes, bytes).
    template <class F>
    void for_each_row(const PixelRect& part, F deed) const;

    PixelRect area_;
    std::uint64_t pixel_bytes_;
    Bytes bytes_;
};

} // namespace fraja::protocol
