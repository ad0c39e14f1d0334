// When a path is too faint to be followed. FORMAT.md, section 6.1.
#pragma once

#include "common/render/render.hpp"

namespace fraja {

/// More light than a ray can see: the brighter of ambient and background, and every light.
[[nodiscard]] Rgb all_light(const World& world);

/// Per component, the coefficient at and below which a path is given up. A component in which no
/// light exists has an infinite one; with `exact` all are 0. Raja's; or, where a pixel may be wrong
/// by settings.error levels, so many times twice that: what is cut then makes up a fifth of the
/// error (measured in overlapping glass, where it is worst).
[[nodiscard]] Rgb cut_level(const World& world, const RenderSettings& settings);

} // namespace fraja
