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
    /// Of each pixel, of a pass over a picture: the variance of its samples, mean over the colours,
    /// as far as it can be seen; and the light that is thought to be missing, as faint rays were
    /// cut.
    std::vector<float> variance = {}, cut = {};
    friend bool operator==(const Tile&, const Tile&) = default;
};

} // namespace fraja
