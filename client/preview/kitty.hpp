// A picture by kitty's graphics protocol, which WezTerm, Ghostty and Konsole understand as well:
// https://sw.kovidgoyal.net/kitty/graphics-protocol/
#pragma once

#include "common/image_io/picture_file.hpp"

#include <cstdint>
#include <string>

namespace fraja::client {

/// Shows the picture from the cursor on, over so many cells, in place of the one of that id; the
/// cursor stays, and the terminal does not answer. `id` is above 0.
[[nodiscard]] std::string kitty_image(const LevelsPicture& levels, std::uint32_t id,
                                      std::uint32_t columns, std::uint32_t rows);
/// Takes it away.
[[nodiscard]] std::string kitty_removal(std::uint32_t id);

} // namespace fraja::client
