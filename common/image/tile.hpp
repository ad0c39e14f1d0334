// A rendered rectangle of a picture.
#pragma once

#include "common/base/pixel_rect.hpp"

#include <vector>

namespace fraja {

/// Scene-linear RGB, row-major from the top left: 3 * rect.width * rect.height floats.
struct Tile {
    PixelRect rect;
    std::vector<float> rgb;
    friend bool operator==(const Tile&, const Tile&) = default;
};

} // namespace fraja
