// A picture of half blocks: what every terminal with colours can show.
#pragma once

#include "common/image_io/picture_file.hpp"

#include <cstdint>
#include <string>

namespace fraja::client {

enum class ColorDepth : std::uint8_t { indexed, direct }; ///< 256 colours, or 24 bits

/// The entry nearest to a colour in the upper 240 of the 256 colours, which no theme changes.
[[nodiscard]] std::uint8_t indexed_color(std::uint8_t r, std::uint8_t g, std::uint8_t b);

/// A row of characters for each two rows of pixels, from the cursor on; each row ends in plain
/// colours, and all but the last in "\r\n".
[[nodiscard]] std::string blocks_image(const LevelsPicture& levels, ColorDepth depth);

} // namespace fraja::client
