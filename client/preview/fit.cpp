#include "client/preview/fit.hpp"

#include "common/base/assert.hpp"

#include <algorithm>
#include <cmath>

namespace fraja::client {
namespace {

struct Size {
    double width, height;
};

/// In pixels of the display.
Size shown_size(Extent picture, const Window& w) {
    FRAJA_ASSERT(picture.pixel_count() > 0);
    FRAJA_ASSERT(w.columns > 0 && w.rows > 0 && w.cell_width > 0 && w.cell_height > 0);
    const double width = double{1} * std::min(w.columns, preview_columns_max) * w.cell_width;
    const double height = double{1} * std::min(w.rows, preview_rows_max) * w.cell_height;
    const double scale = std::min(width / picture.width, height / picture.height);
    return {scale * picture.width, scale * picture.height};
}

std::uint32_t at_least_one(double count) {
    return static_cast<std::uint32_t>(std::max(1.0, std::round(count)));
}

} // namespace

Fit fit_blocks(Extent picture, const Window& w) {
    const Size size = shown_size(picture, w);
    const Extent pixels{at_least_one(size.width / w.cell_width),
                        at_least_one(2 * size.height / w.cell_height)};
    return {pixels.width, (pixels.height + 1) / 2, pixels};
}

Fit fit_kitty(Extent picture, const Window& w) {
    const Size size = shown_size(picture, w);
    return {at_least_one(size.width / w.cell_width),
            at_least_one(size.height / w.cell_height),
            {std::min(picture.width, at_least_one(size.width)),
             std::min(picture.height, at_least_one(size.height))}};
}

Fit fit_sixel(Extent picture, const Window& w) {
    constexpr std::uint32_t sixel = 6;
    const Size size = shown_size(picture, w);
    // Rounded down: not below the rows there are.
    const auto height = std::max(sixel, static_cast<std::uint32_t>(size.height) / sixel * sixel);
    const Extent pixels{at_least_one(std::floor(size.width)), height};
    return {(pixels.width + w.cell_width - 1) / w.cell_width,
            (pixels.height + w.cell_height - 1) / w.cell_height, pixels};
}

} // namespace fraja::client
