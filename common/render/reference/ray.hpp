// Points that know the form they lie on, and rays. FORMAT.md, sections 3 and 8.1.
#pragma once

#include "common/math/vec.hpp"
#include "common/scene/scene.hpp"

namespace fraja::reference {

/// The owner of a point that lies on no form: a camera's.
inline constexpr FormIndex no_owner{0xffff'ffff};

/// A place and the primitive form on which it was found. Instead of an epsilon, Raja asks who owns
/// a ray's start: a form never meets again, by rounding, the ray that just left it.
struct Point {
    Vec3 position{};
    FormIndex owner = no_owner;
};

/// start + t * dir, t > 0.
struct Ray {
    Point start;
    Vec3 dir{}; ///< unit; NaN (of a zero direction) meets nothing
};

/// Every ray normalises its direction when it is made, also one of length 1, whose last bits may
/// change by that.
[[nodiscard]] inline Ray make_ray(const Point& start, const Vec3& dir) {
    return {start, normalized(dir)};
}

[[nodiscard]] inline double distance_squared(const Vec3& a, const Vec3& b) {
    return length_squared(a - b);
}

} // namespace fraja::reference
