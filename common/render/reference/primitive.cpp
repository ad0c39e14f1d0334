#include "common/render/reference/primitive.hpp"

#include <cmath>

namespace fraja::reference {
namespace {

/// The part of `v` across the unit vector `n`.
Vec3 across(const Vec3& v, const Vec3& n) {
    return v + (-dot(v, n)) * n;
}

/// a t^2 + b t + c = 0
struct Quadratic {
    double a, b, c;
};

Quadratic quadratic(const UnitSphere& s, const Ray& ray) {
    const Vec3 from_center = ray.start.position - s.center;
    return {length_squared(ray.dir), 2 * dot(from_center, ray.dir),
            length_squared(from_center) - s.radius * s.radius};
}

Quadratic quadratic(const UnitCylinder& s, const Ray& ray) {
    const Vec3 start = across(ray.start.position - s.origin, s.axis);
    const Vec3 dir = across(ray.dir, s.axis);
    return {length_squared(dir), 2 * dot(start, dir), length_squared(start) - s.radius * s.radius};
}

Quadratic quadratic(const UnitCone& s, const Ray& ray) {
    const Vec3 from_tip = ray.start.position - s.origin;
    const double k_squared = s.cos_angle * s.cos_angle;
    const double dir_along = dot(ray.dir, s.axis);
    const double start_along = dot(from_tip, s.axis);
    return {dir_along * dir_along - k_squared,
            2 * (start_along * dir_along - k_squared * dot(from_tip, ray.dir)),
            start_along * start_along - k_squared * length_squared(from_tip)};
}

Vec3 raw_normal(const UnitSphere& s, const Vec3& p) {
    return normalized(p - s.center);
}

Vec3 raw_normal(const UnitPlane& s, const Vec3&) {
    return s.normal;
}

Vec3 raw_normal(const UnitCylinder& s, const Vec3& p) {
    return normalized(across(p - s.origin, s.axis));
}

Vec3 raw_normal(const UnitCone& s, const Vec3& p) {
    const double k = s.cos_angle;
    double along_axis = -std::sqrt(1 / (1 - k * k));
    const double along_side = -(along_axis * k);
    const Vec3 side = normalized(p - s.origin);
    if (dot(side, s.axis) < 0)
        along_axis = -along_axis;
    return along_side * side + along_axis * s.axis;
}

/// Where the formula has no answer (FORMAT.md, section 13).
Vec3 substitute_normal(const UnitCone& s) {
    return is_finite(s.axis) ? s.axis : Vec3{0, 0, 1};
}
template <class Shape>
Vec3 substitute_normal(const Shape&) {
    return {0, 0, 1};
}

template <class Shape>
Vec3 finite_normal(const Shape& s, const Vec3& p) {
    const Vec3 n = raw_normal(s, p);
    return is_finite(n) ? n : substitute_normal(s);
}

std::optional<Point> point_at(FormIndex owner, const Ray& ray, double t) {
    const Vec3 position = ray.start.position + t * ray.dir;
    if (!is_finite(position)) // an overflow, far beyond anything a scene can show
        return std::nullopt;
    return Point{position, owner};
}

std::optional<Point> first_point(FormIndex self, const UnitPlane& s, const Ray& ray) {
    const double facing = dot(s.normal, ray.dir);
    if (facing == 0 || ray.start.owner == self)
        return std::nullopt;
    const double t = dot(s.normal, s.origin - ray.start.position) / facing;
    return t > 0 ? point_at(self, ray, t) : std::nullopt;
}

/// The acne rule of section 9: a ray that leaves a surface outwards can only come back inwards, and
/// the other way round.
template <class Shape>
bool valid(FormIndex self, const Shape& s, const Ray& ray, const Point& candidate) {
    if (ray.start.owner != self)
        return true;
    return dot(finite_normal(s, ray.start.position), ray.dir) *
               dot(finite_normal(s, candidate.position), ray.dir) <=
           0;
}

template <class Shape>
std::optional<Point> first_point(FormIndex self, const Shape& s, const Ray& ray) {
    const auto at = [&](double t) -> std::optional<Point> {
        if (!(t > 0))
            return std::nullopt;
        const std::optional<Point> p = point_at(self, ray, t);
        return p && valid(self, s, ray, *p) ? p : std::nullopt;
    };
    const auto [a, b, c] = quadratic(s, ray);
    if (a == 0)
        return b != 0 ? at(-c / b) : std::nullopt;
    const double discriminant = b * b - (4 * a) * c;
    if (!(discriminant >= 0))
        return std::nullopt;
    const double root = std::sqrt(discriminant);
    double t1 = (-b - root) / (2 * a);
    double t2 = (-b + root) / (2 * a);
    if (a < 0)
        std::swap(t1, t2);
    if (!(t2 > 0))
        return std::nullopt;
    if (const std::optional<Point> near = at(t1))
        return near;
    return at(t2);
}

/// A measure of depth below the surface, compared by `contains` with >= and > to `surface`.
struct Depth {
    double inner, surface;
};

Depth depth(const UnitSphere& s, const Vec3& p) {
    return {s.radius, length(p - s.center)};
}
Depth depth(const UnitPlane& s, const Vec3& p) {
    return {0, dot(s.normal, p - s.origin)};
}
Depth depth(const UnitCylinder& s, const Vec3& p) {
    return {s.radius, length(across(p - s.origin, s.axis))};
}
Depth depth(const UnitCone& s, const Vec3& p) {
    const Vec3 from_tip = p - s.origin;
    return {std::abs(dot(from_tip, s.axis)), s.cos_angle * length(from_tip)};
}

} // namespace

Primitive make_primitive(FormIndex index, const Form& form) {
    struct Prepare {
        FormIndex index;
        Primitive operator()(const Sphere& s) const {
            return {index, UnitSphere{s.center, s.radius}};
        }
        Primitive operator()(const Plane& s) const {
            return {index, UnitPlane{s.origin, normalized(s.normal)}};
        }
        Primitive operator()(const Cylinder& s) const {
            return {index, UnitCylinder{s.origin, normalized(s.direction), s.radius}};
        }
        Primitive operator()(const Cone& s) const {
            return {index, UnitCone{s.origin, normalized(s.direction), std::cos(s.angle_rad)}};
        }
    };
    return std::visit(Prepare{index}, form);
}

Vec3 normal(const Primitive& primitive, const Vec3& position) {
    return std::visit([&](const auto& s) { return finite_normal(s, position); }, primitive.shape);
}

std::optional<Point> intersect(const Primitive& primitive, const Ray& ray) {
    return std::visit([&](const auto& s) { return first_point(primitive.index, s, ray); },
                      primitive.shape);
}

bool contains(const Primitive& primitive, const Point& point) {
    if (point.owner == primitive.index)
        return true;
    const auto [inner, surface] =
        std::visit([&](const auto& s) { return depth(s, point.position); }, primitive.shape);
    return surface <= inner;
}

bool strictly_contains(const Primitive& primitive, const Point& point) {
    if (point.owner == primitive.index)
        return false;
    const auto [inner, surface] =
        std::visit([&](const auto& s) { return depth(s, point.position); }, primitive.shape);
    return surface < inner;
}

} // namespace fraja::reference
