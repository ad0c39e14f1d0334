// Writes a scene as Raja's text (.raj), for Raja, for people and for read_raj.
#pragma once

#include "common/scene/scene.hpp"

#include <string>

namespace fraja {

/// Text that draws the very same picture: read_raj(write_raj(s)) == canonical_order(s).
///
/// Forms, textures, textured forms and solids that several places share are labelled where they
/// come first and referred to from then on, as are solids with priorities. Solids keep the labels
/// of `solid_names` that can be written and that no other solid has. Numbers read back to the same
/// bits.
///
/// The scene must be one that read_raj could give: every index within its table, no cycle,
/// priorities between members only (asserted), numbers finite.
[[nodiscard]] std::string write_raj(const Scene& scene);

} // namespace fraja
