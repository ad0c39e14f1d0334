// From scene-linear floats to 8 bits per channel: as Raja does it (FORMAT.md, section 10), or
// otherwise.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace fraja {

/// Of an 8-bit picture, from black to a radiance of 1.
inline constexpr double levels_per_unit = 255;

/// 0..255: no gamma, no dithering; above 1 is 255, below 0 and NaN are 0. In single precision,
/// which shows: 0.34705882152941175, rounded to float, gives 89, where double arithmetic would
/// give 88.
[[nodiscard]] std::uint8_t quantise(float linear);

/// How radiance becomes levels. In each, above 1 is 255, below 0 and NaN are 0.
enum class Transfer : std::uint8_t {
    raja,   ///< quantise() above: no gamma, in single precision
    srgb,   ///< the curve of IEC 61966-2-1, which displays expect: middle tones are brighter
    linear, ///< no gamma, the nearest level
};

/// Each of them.
[[nodiscard]] std::vector<std::uint8_t> quantise(std::span<const float> linear,
                                                 Transfer transfer = Transfer::raja);

} // namespace fraja
