// The four primitive forms as Raja computes them. FORMAT.md, sections 8.2, 8.3 and 9.
#pragma once

#include "common/geometry/forms.hpp"
#include "common/render/reference/ray.hpp"

#include <optional>
#include <variant>

namespace fraja::reference {

/// Forms whose directions are unit and whose constants are computed, once per scene.
struct UnitSphere {
    Vec3 center;
    double radius;
};
struct UnitPlane {
    Vec3 origin, normal;
};
struct UnitCylinder {
    Vec3 origin, axis;
    double radius;
};
struct UnitCone {
    Vec3 origin, axis;
    double cos_angle;
};

/// A primitive form and its identity.
struct Primitive {
    FormIndex index;
    std::variant<UnitSphere, UnitPlane, UnitCylinder, UnitCone> shape;
};

[[nodiscard]] Primitive make_primitive(FormIndex index, const Form& form);

/// The outward normal at a point of the surface, as Raja computes it; of a cone it is not
/// normalised again. Where it has none (the tip of a cone, a centre) Raja fails; here a cone gives
/// its axis and the others (0, 0, 1): always finite.
[[nodiscard]] Vec3 normal(const Primitive& primitive, const Vec3& position);

/// The first point of the ray on the surface, owned by this primitive. A point that is not finite
/// is none.
[[nodiscard]] std::optional<Point> intersect(const Primitive& primitive, const Ray& ray);

/// Within or on the surface; true of every point the primitive owns.
[[nodiscard]] bool contains(const Primitive& primitive, const Point& point);
/// Within the surface; false of every point the primitive owns.
[[nodiscard]] bool strictly_contains(const Primitive& primitive, const Point& point);

} // namespace fraja::reference
