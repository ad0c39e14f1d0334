// When a path is too faint to be followed. FORMAT.md, section 6.1.
#pragma once

#include "common/scene/scene.hpp"

namespace fraja {

/// Per component, the coefficient at and below which a path is given up. A component in which no
/// light exists has an infinite one; with `exact` all are 0.
[[nodiscard]] Rgb cut_level(const World& world, bool exact);

} // namespace fraja
