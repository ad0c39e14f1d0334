// What to tell the author of a scene whose solids overlap without a priority.
#pragma once

#include "common/render/priorities.hpp"
#include "common/scene/scene.hpp"

#include <span>
#include <string>

namespace fraja {

/// Names two solids of `set` (which has at least two) that neither has priority over the other and
/// the cure; or, if there are no such two, some whose priorities go round in a circle.
[[nodiscard]] std::string overlap_message(const Scene& scene, const Priorities& priorities,
                                          std::span<const SolidIndex> set);

} // namespace fraja
