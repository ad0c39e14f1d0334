// Pixels as they travel: of each its colour, plane by plane what else there is, cut into frames.
#pragma once

#include "common/base/bytes.hpp"
#include "common/base/pixel_rect.hpp"

#include <cstdint>
#include <vector>

namespace fraja::protocol {

inline constexpr std::uint64_t colour_bytes = 12; ///< of a pixel, in the first plane
inline constexpr std::uint64_t plane_bytes = 4;   ///< of a pixel, in each that follows

/// Of the pixels of `rect` those of `part`, which lies in it. The blobs must have `pixel_bytes` for
/// each pixel in all (asserted): `colour_bytes`, and `plane_bytes` for each further plane.
[[nodiscard]] std::vector<Blob> pixels_of_part(const std::vector<Blob>& blobs,
                                               const PixelRect& rect, const PixelRect& part,
                                               std::uint64_t pixel_bytes);

} // namespace fraja::protocol
