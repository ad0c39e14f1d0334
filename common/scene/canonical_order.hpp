// One order for a scene's tables, so that equal scenes compare equal.
#pragma once

#include "common/scene/scene.hpp"

namespace fraja {

/// The same scene without entries that nothing refers to, each table in the order in which a walk
/// from the world's solid (then its ambient volume) leaves the entries: parts before the whole,
/// members in the order of their lists, textureIn before textureOut. The picture is the same.
/// Recurses as deep as the scene is nested, which the reader limits.
[[nodiscard]] Scene canonical_order(Scene scene);

} // namespace fraja
