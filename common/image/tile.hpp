// A rendered rectangle of a picture.
#pragma once

#include "common/base/pixel_rect.hpp"

#include <array>
#include <string_view>
#include <vector>

namespace fraja {

/// The distance from the eye, infinite where there is nothing; the unit normal of the surface, out
/// of the solid, world space; the number of the solid in its scene, from 1, or 0 (exact up to
/// 2^24).
inline constexpr std::array<std::string_view, 5> layer_names = {"Z", "N.X", "N.Y", "N.Z", "object"};

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
    /// What stands at the middle of each pixel: `layer_names`, one plane of a float a pixel after
    /// the other. Empty where that is not told.
    std::vector<float> layers = {};
    friend bool operator==(const Tile&, const Tile&) = default;
};

} // namespace fraja
