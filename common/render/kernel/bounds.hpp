// Spheres around what formulas fill, where they fill a bounded part of space.
#pragma once

#include "common/math/vec.hpp"
#include "common/render/kernel/expression.hpp"
#include "common/render/kernel/surfaces.hpp"

#include <cstdint>

namespace fraja::kernel {

struct BoundingSphere {
    Vec3 center{};
    double radius = 0; ///< infinite where no bound is known; less than 0 around nothing
};

/// Surfaces have numbers of Tables. Known are: spheres, cylinders and cones capped by planes,
/// polyhedra of up to 24 planes, and unions and intersections of these.
[[nodiscard]] BoundingSphere bounding_sphere(const Expression& e,
                                             const SurfaceCollector::Sorted& surfaces);

/// What a formula is at some places.
enum class Holds : std::uint8_t { never, sometimes, always };

/// At all places of a sphere; `sometimes` also where that is not known.
[[nodiscard]] Holds holds_throughout(const BoundingSphere& places, const Expression& e,
                                     const SurfaceCollector::Sorted& surfaces);

} // namespace fraja::kernel
