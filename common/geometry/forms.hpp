// The four primitive forms as values. World space; lengths in the scene's own unit.
#pragma once

#include "common/math/vec.hpp"

#include <variant>

namespace fraja {

struct Sphere {
    Vec3 center{};
    double radius = 0; ///< any sign: only its square counts, as in Raja, but for containment
    friend bool operator==(const Sphere&, const Sphere&) = default;
};

/// The half-space behind `normal` (which need not be unit) through `origin`.
struct Plane {
    Vec3 origin{}, normal{};
    friend bool operator==(const Plane&, const Plane&) = default;
};

/// Infinite both ways.
struct Cylinder {
    Vec3 origin{}, direction{};
    double radius = 0;
    friend bool operator==(const Cylinder&, const Cylinder&) = default;
};

/// Double (two nappes) and infinite; `origin` is the tip.
struct Cone {
    Vec3 origin{}, direction{};
    double angle_rad = 0; ///< from the axis to the surface
    friend bool operator==(const Cone&, const Cone&) = default;
};

using Form = std::variant<Sphere, Plane, Cylinder, Cone>;

} // namespace fraja
