// What a surface does with light at a point. FORMAT.md, sections 2.1 and 2.2.
#pragma once

#include "common/scene/scene.hpp"

namespace fraja::reference {

/// The local texture at a point in world space. Chequers with a step of 0 show their second colour.
[[nodiscard]] LocalTexture texture_at(const Texture& texture, const Vec3& p);

} // namespace fraja::reference
