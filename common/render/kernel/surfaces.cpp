#include "common/render/kernel/surfaces.hpp"

#include "common/render/kernel/exact_angle.hpp"
#include "common/render/kernel/triples.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <variant>

namespace fraja::kernel {
namespace {

/// The one of v and -v whose first component that is not 0 is positive.
Vec3 canonical(const Vec3& v) {
    const double sign = v.x != 0 ? v.x : v.y != 0 ? v.y : v.z;
    return sign < 0 ? -v : v;
}

/// A unit vector; of a direction without a length (1e-200, 1e200) all the same.
Vec3 unit(const Vec3& v) {
    const double most = std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)});
    return normalized(v / most);
}

/// Along a coordinate axis, where that is exact, without its part along the axis: the same of all
/// points that give the same line.
Vec3 off_axis(const Vec3& p, const Vec3& unit_axis) {
    for (int c = 0; c < 3; ++c)
        if (unit_axis[c] == 1)
            return {c == 0 ? 0 : p.x, c == 1 ? 0 : p.y, c == 2 ? 0 : p.z};
    return p;
}

} // namespace

SphereSurface surface_of(const Sphere& sphere, const Vec3& center) {
    SphereSurface s{};
    put(s.center, sphere.center - center);
    s.radius = std::abs(sphere.radius);
    return s;
}

SurfaceCollector::Key SurfaceCollector::key_of(SurfaceKind kind,
                                               std::initializer_list<double> numbers) {
    Key key{static_cast<std::uint64_t>(kind)};
    std::size_t next = 1;
    for (const double number : numbers)
        key[next++] = std::bit_cast<std::uint64_t>(number + 0.0); // -0 is 0
    return key;
}

template <class Table, class Entry>
std::uint32_t SurfaceCollector::add(SurfaceKind kind, Table& table, const Key& key,
                                    const Entry& entry) {
    const auto [at, is_new] = known_.try_emplace(key, static_cast<std::uint32_t>(order_.size()));
    if (is_new) {
        order_.push_back({kind, static_cast<std::uint32_t>(table.size())});
        table.push_back(entry);
    }
    return at->second;
}

Side SurfaceCollector::add(const Form& form, bool complement) {
    return std::visit([&](const auto& shape) { return add(shape, complement); }, form);
}

Side SurfaceCollector::add(const Sphere& s, bool complement) {
    const SphereSurface entry = surface_of(s, center_);
    const Key key = key_of(SurfaceKind::sphere,
                           {entry.center[0], entry.center[1], entry.center[2], entry.radius});
    return {add(SurfaceKind::sphere, spheres_, key, entry), complement};
}

Side SurfaceCollector::add(const Plane& s, bool complement) {
    const Vec3 point = s.origin - center_;
    const Vec3 direction = complement ? -s.normal : s.normal; // the other half-space
    const Vec3 normal = unit(direction);
    PlaneSurface entry{};
    put(entry.normal, normal);
    put(entry.direction, direction);
    put(entry.point, point);
    entry.distance = dot(normal, point);
    const Vec3 n = canonical(normal);
    const Key key = key_of(SurfaceKind::plane, {n.x, n.y, n.z, dot(n, point)});
    const std::uint32_t number = add(SurfaceKind::plane, planes_, key, entry);
    const Vec3 known = vec(planes_[order_[number].index].normal);
    return {number, dot(known, normal) < 0};
}

Side SurfaceCollector::add(const Cylinder& s, bool complement) {
    CylinderSurface entry{};
    const Vec3 u = canonical(unit(s.direction));
    const Vec3 origin = off_axis(s.origin - center_, u);
    put(entry.origin, origin);
    put(entry.axis, unit(s.direction));
    put(entry.direction, s.direction);
    entry.radius = std::abs(s.radius);
    const DoubleDouble squared = scaled_length_squared(entry.direction, {1, 0});
    entry.direction_squared[0] = squared.high, entry.direction_squared[1] = squared.low;
    const Key key =
        key_of(SurfaceKind::cylinder, {u.x, u.y, u.z, origin.x, origin.y, origin.z, entry.radius});
    return {add(SurfaceKind::cylinder, cylinders_, key, entry), complement};
}

Side SurfaceCollector::add(const Cone& s, bool complement) {
    const ExactAngle angle = exact_angle(s.angle_rad);
    ConeSurface entry{};
    put(entry.origin, s.origin - center_);
    put(entry.axis, unit(s.direction));
    put(entry.direction, s.direction);
    entry.slope = angle.tangent;
    entry.slope_squared = angle.tangent * angle.tangent;
    const DoubleDouble scaled = scaled_length_squared(entry.direction, angle.cosine_squared);
    entry.scaled_cosine[0] = scaled.high, entry.scaled_cosine[1] = scaled.low;
    const Vec3 u = canonical(unit(s.direction));
    const Key key = key_of(SurfaceKind::cone, {u.x, u.y, u.z, entry.origin[0], entry.origin[1],
                                               entry.origin[2], entry.slope});
    return {add(SurfaceKind::cone, cones_, key, entry), complement};
}

SurfaceCollector::Sorted SurfaceCollector::sorted() const {
    Sorted s{spheres_, planes_, cylinders_, cones_, {}};
    const std::uint32_t first[4] = {
        0, static_cast<std::uint32_t>(spheres_.size()),
        static_cast<std::uint32_t>(spheres_.size() + planes_.size()),
        static_cast<std::uint32_t>(spheres_.size() + planes_.size() + cylinders_.size())};
    for (const Place& place : order_)
        s.new_number.push_back(first[static_cast<std::size_t>(place.kind)] + place.index);
    return s;
}

double side_of(const SphereSurface& s, const Vec3& p) {
    return length(p - vec(s.center)) - s.radius;
}

namespace {

using Sided = SurfaceCollector::Sorted::Sided;

/// Much more than rounding can have done to a distance from something that is given so far away.
double error_at(const Vec3& p, const Vec3& from_anchor) {
    return 1e-14 * (length(p) + length(from_anchor));
}
Sided sided(const SphereSurface& s, const Vec3& p) {
    return {side_of(s, p), error_at(p, p - vec(s.center)) + 1e-14 * s.radius};
}
Sided sided(const PlaneSurface& s, const Vec3& p) {
    const Vec3 f = p - vec(s.point);
    return {dot(vec(s.normal), f), error_at(p, f)};
}
Sided sided(const CylinderSurface& s, const Vec3& p) {
    const Vec3 f = p - vec(s.origin);
    return {length(cross(f, vec(s.axis))) - s.radius, error_at(p, f) + 1e-14 * s.radius};
}
Sided sided(const ConeSurface& s, const Vec3& p) {
    const Vec3 f = p - vec(s.origin);
    const double off = length(cross(f, vec(s.axis))) - s.slope * std::abs(dot(f, vec(s.axis)));
    return {off / (1 + s.slope), error_at(p, f)}; // grows no faster than one goes
}

} // namespace

SurfaceCollector::Sorted::Sided SurfaceCollector::Sorted::side_of(std::uint32_t surface,
                                                                  const Vec3& p) const {
    if (surface < spheres.size())
        return sided(spheres[surface], p);
    surface -= static_cast<std::uint32_t>(spheres.size());
    if (surface < planes.size())
        return sided(planes[surface], p);
    surface -= static_cast<std::uint32_t>(planes.size());
    if (surface < cylinders.size())
        return sided(cylinders[surface], p);
    return sided(cones[surface - cylinders.size()], p);
}

std::vector<std::uint32_t> SurfaceCollector::Sorted::keep(const std::vector<bool>& used) {
    std::vector<std::uint32_t> numbers(size());
    std::uint32_t old = 0, next = 0;
    const auto compact = [&](auto& table) {
        std::erase_if(table, [&](const auto&) {
            numbers[old] = next;
            next += used[old] ? 1u : 0u;
            return !used[old++];
        });
    };
    compact(spheres), compact(planes), compact(cylinders), compact(cones);
    return numbers;
}

} // namespace fraja::kernel
