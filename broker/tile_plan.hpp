// Into which cells a picture is cut, and in which order they are handed out.
#pragma once

#include "common/protocol/settings.hpp"

#include <cstdint>
#include <vector>

namespace fraja::broker {

/// The side of the cells where the client leaves the choice: tiles are rectangles of them then, so
/// they are as small as the smallest tile that may be wanted in the end. A power of two from 2 on,
/// and at most `automatic_cells_max` of them. From 8 on for adaptive pictures, whose tiles draw
/// samples around them, too. With a time limit every tile is one cell, so that is as large as is
/// good for a tile: 32, or 64 of a large picture.
[[nodiscard]] std::uint32_t automatic_cell_side(const protocol::PictureSettings& settings);
inline constexpr std::uint64_t automatic_cells_max = std::uint64_t{1} << 18;

/// The numbers, row by row, of so many columns and rows, in the order in which they are to be
/// handed out.
[[nodiscard]] std::vector<std::uint32_t> ordered_cells(std::uint32_t columns, std::uint32_t rows,
                                                       protocol::TileOrder order);

} // namespace fraja::broker
