// A bounding volume hierarchy over spheres, eight boxes wide.
#pragma once

#include "common/render/kernel/tables.hpp"

#include <cstdint>
#include <vector>

namespace fraja::kernel {

struct Bvh {
    std::vector<BvhNode> nodes;       ///< the root first; none over no spheres
    std::vector<std::uint32_t> order; ///< of the spheres, so that those of a leaf stand together
};

/// By the surface area heuristic over bins (I. Wald, "On fast Construction of SAH-based Bounding
/// Volume Hierarchies", 2007), two ways at a time, then eight. Same spheres, same hierarchy.
[[nodiscard]] Bvh build_bvh(const std::vector<SphereSurface>& spheres);

} // namespace fraja::kernel
