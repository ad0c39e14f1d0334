// How large a picture is shown in a terminal's window.
#pragma once

#include "common/base/pixel_rect.hpp"

#include <cstdint>

namespace fraja::client {

/// A terminal's window. What a terminal does not tell is as here.
struct Window {
    std::uint32_t columns = 80, rows = 24;
    std::uint32_t cell_width = 10, cell_height = 20; ///< in pixels of the display
    bool pixels_known = false;                       ///< the terminal has told these
    friend bool operator==(const Window&, const Window&) = default;
};

/// No picture is shown larger, whatever a terminal says of itself.
inline constexpr std::uint32_t preview_columns_max = 512, preview_rows_max = 256;

/// The place of a picture, and how many of its pixels are worth sending.
struct Fit {
    std::uint32_t columns = 0, rows = 0;
    Extent pixels;
    friend bool operator==(const Fit&, const Fit&) = default;
};

// As large as the window allows, in the picture's own shape; at least one cell. Neither the picture
// nor the window may be empty (asserted).

/// Each cell is two pixels, one above the other.
[[nodiscard]] Fit fit_blocks(Extent picture, const Window& window);
/// The terminal enlarges: never more pixels than the picture has.
[[nodiscard]] Fit fit_kitty(Extent picture, const Window& window);
/// Pixels of the display; their height is a multiple of a sixel's 6.
[[nodiscard]] Fit fit_sixel(Extent picture, const Window& window);

} // namespace fraja::client
