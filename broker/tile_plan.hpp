// How a picture is cut into tiles, and in which order they are handed out.
#pragma once

#include "common/base/pixel_rect.hpp"
#include "common/protocol/settings.hpp"

#include <cstdint>
#include <vector>

namespace fraja::broker {

/// The side used where the client leaves the choice: about 256 tiles, 8 to 64 pixels, a multiple
/// of 8. 32 or 64 where small tiles cost more than they bring: those of adaptive pictures draw
/// samples around them, too, of which whole cells of 32 need the fewest; with a time limit a tile
/// of the first passes has 4 samples a pixel.
[[nodiscard]] std::uint32_t automatic_tile_side(const protocol::PictureSettings& settings);

/// Cuts `crop` along a grid of squares of `side` pixels from the picture's top left (less at the
/// crop's borders), each pixel in exactly one, in the order in which they are to be handed out.
/// `side` must not be 0.
[[nodiscard]] std::vector<PixelRect> plan_tiles(PixelRect crop, std::uint32_t side,
                                                protocol::TileOrder order);

/// How many that are.
[[nodiscard]] std::uint64_t tile_count(PixelRect crop, std::uint32_t side);

} // namespace fraja::broker
