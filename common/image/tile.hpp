// A rendered rectangle of a picture.
#pragma once

#include "common/base/pixel_rect.hpp"

#include <vector>

namespace fraja {

/// Scene-linear RGB, row-major from the top left: 3 * rect.width * rect.height floats.
struct Tile {
    PixelRect rect;
    std::vector<float> rgb;
    /// Of each pixel its samples, and what its error is thought to be: root of the mean square over
    /// the colours, in units of the radiance. Empty where that is not told.
    std::vector<float> samples = {}, error = {};
    /// Of each pixel, of a pass over a picture: the mean of the squares of its samples' colours.
    std::vector<float> squares = {};
    friend bool operator==(const Tile&, const Tile&) = default;
};

} // namespace fraja
