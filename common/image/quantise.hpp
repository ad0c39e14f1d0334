// From scene-linear floats to the 8 bits per channel of Raja's pictures. FORMAT.md, section 10.
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

/// Each of them.
[[nodiscard]] std::vector<std::uint8_t> quantise(std::span<const float> linear);

} // namespace fraja
