// Vectors, points and colours: GLM's, in double precision, with the arithmetic order that Raja's
// pictures need.
#pragma once

#include <cmath>
#include <glm/vec3.hpp>

namespace fraja {

using Vec3 = glm::dvec3; ///< a point or a direction, world space unless a name says otherwise
using Rgb = glm::dvec3;  ///< scene-linear, each >= 0, not limited to 1

/// (ax bx + ay by) + az bz, in this order.
[[nodiscard]] inline double dot(const Vec3& a, const Vec3& b) {
    return (a.x * b.x + a.y * b.y) + a.z * b.z;
}
[[nodiscard]] inline double length_squared(const Vec3& v) {
    return dot(v, v);
}
[[nodiscard]] inline double length(const Vec3& v) {
    return std::sqrt(dot(v, v));
}
/// v times the reciprocal of its length. The zero vector gives NaN: the reader refuses it, rays
/// check.
[[nodiscard]] inline Vec3 normalized(const Vec3& v) {
    return v * (1.0 / length(v));
}
[[nodiscard]] inline Vec3 cross(const Vec3& a, const Vec3& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/// Neither NaN nor infinite in any component.
[[nodiscard]] inline bool is_finite(const Vec3& v) {
    return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

} // namespace fraja
