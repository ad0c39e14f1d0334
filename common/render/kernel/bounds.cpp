#include "common/render/kernel/bounds.hpp"

#include "common/render/kernel/triples.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

namespace fraja::kernel {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr std::size_t polyhedron_planes_max = 24;
/// Sines (of two normals; products of three) below the first are 0 but for rounding. Of those
/// between both a corner is too inaccurate to count on.
constexpr double parallel = 1e-15, nearly_parallel = 1e-9;

/// More than rounding can have taken away.
BoundingSphere widened(BoundingSphere b) {
    b.radius += 1e-9 * (b.radius + length(b.center));
    return b;
}

/// The points x with normal . x <= distance.
struct HalfSpace {
    Vec3 normal;
    double distance;
};

/// Along an axis, from its origin.
struct Range {
    double low = -infinity, high = infinity;
    [[nodiscard]] bool bounded() const { return std::isfinite(low) && std::isfinite(high); }
};

/// Where on its axis a cylinder (of that radius) or a cone (of that slope) can reach a half-space.
struct Axis {
    Vec3 origin, dir;
    double radius = 0, slope = 0;

    void limit(Range& range, const HalfSpace& half) const {
        const double along = dot(half.normal, dir);
        const double across = length(half.normal - along * dir);
        const double room = half.distance - dot(half.normal, origin) + radius * across;
        const double up = along - slope * across;   // per length, on the nappe ahead
        const double down = along + slope * across; // on the one behind
        if (up > 1e-9)
            range.high = std::min(range.high, room >= 0 ? room / up : room / down);
        else if (down < -1e-9)
            range.low = std::max(range.low, room >= 0 ? room / down : room / up);
    }

    [[nodiscard]] BoundingSphere around(const Range& range) const {
        if (!range.bounded())
            return {{}, infinity};
        if (range.low > range.high)
            return {{}, -1};
        const double middle = 0.5 * (range.low + range.high);
        double squared = 0;
        for (const double end : {range.low, range.high}) {
            const double r = radius + slope * std::abs(end);
            squared = std::max(squared, (end - middle) * (end - middle) + r * r);
        }
        return widened({origin + middle * dir, std::sqrt(squared)});
    }
};

bool reaches_infinity(const std::vector<HalfSpace>& halves) {
    const auto recedes = [&](const Vec3& v) {
        return std::all_of(halves.begin(), halves.end(), [&](const HalfSpace& h) {
            return dot(h.normal, v) <= 1e-9 * length(v);
        });
    };
    bool pointed = false; // else it contains a whole line
    for (std::size_t i = 0; i < halves.size(); ++i)
        for (std::size_t j = 0; j < i; ++j) {
            const Vec3 edge = cross(halves[i].normal, halves[j].normal);
            if (length(edge) < parallel)
                continue;
            if (length(edge) < nearly_parallel)
                return true; // as far as is known
            if (recedes(edge) || recedes(-edge))
                return true;
            for (const HalfSpace& h : halves)
                pointed |= std::abs(dot(h.normal, edge)) > 1e-9;
        }
    return !pointed;
}

BoundingSphere around_polyhedron(const std::vector<HalfSpace>& halves) {
    if (halves.size() < 4 || halves.size() > polyhedron_planes_max || reaches_infinity(halves))
        return {{}, infinity};
    std::vector<Vec3> corners;
    for (std::size_t i = 0; i < halves.size(); ++i)
        for (std::size_t j = 0; j < i; ++j)
            for (std::size_t k = 0; k < j; ++k) {
                const HalfSpace &a = halves[i], &b = halves[j], &c = halves[k];
                const Vec3 bc = cross(b.normal, c.normal);
                const double det = dot(a.normal, bc);
                if (std::abs(det) < parallel)
                    continue;
                if (std::abs(det) < nearly_parallel)
                    return {{}, infinity};
                const Vec3 p = (a.distance * bc + b.distance * cross(c.normal, a.normal) +
                                c.distance * cross(a.normal, b.normal)) /
                               det;
                const double slack = 1e-6 * (length(p) + std::abs(a.distance));
                if (std::all_of(halves.begin(), halves.end(), [&](const HalfSpace& h) {
                        return dot(h.normal, p) <= h.distance + slack;
                    }))
                    corners.push_back(p);
            }
    if (corners.empty())
        return {{}, infinity}; // nothing, most likely; but slack must not make it so
    BoundingSphere b;
    for (const Vec3& corner : corners)
        b.center += corner / static_cast<double>(corners.size());
    for (const Vec3& corner : corners)
        b.radius = std::max(b.radius, length(corner - b.center));
    b.radius *= 1 + 1e-5;
    return widened(b);
}

BoundingSphere around_both(const BoundingSphere& a, const BoundingSphere& b) {
    if (a.radius < 0 || !(b.radius < infinity))
        return b;
    if (b.radius < 0 || !(a.radius < infinity))
        return a;
    const Vec3 way = b.center - a.center;
    const double distance = length(way);
    if (distance + b.radius <= a.radius)
        return a;
    if (distance + a.radius <= b.radius)
        return b;
    const double radius = 0.5 * (distance + a.radius + b.radius);
    return widened({a.center + ((radius - a.radius) / distance) * way, radius});
}

class Bounder {
public:
    explicit Bounder(const SurfaceCollector::Sorted& surfaces) : s_(surfaces) {}

    BoundingSphere around(const Expression& e) const {
        switch (e.kind) {
        case Expression::Kind::never:
            return {{}, -1};
        case Expression::Kind::always:
            return {{}, infinity};
        case Expression::Kind::literal:
            return around_all({e});
        case Expression::Kind::all:
            return around_all(e.parts);
        case Expression::Kind::any:
            break;
        }
        BoundingSphere b{{}, -1};
        for (const Expression& part : e.parts) {
            const BoundingSphere p = around(part);
            if (!(p.radius < infinity))
                return {{}, infinity};
            b = around_both(b, p);
        }
        return b;
    }

private:
    BoundingSphere around_all(const std::vector<Expression>& parts) const {
        std::vector<HalfSpace> halves;
        for (const Expression& part : parts)
            if (const auto half = half_space(part))
                halves.push_back(*half);
        BoundingSphere best{{}, infinity};
        const auto offer = [&](const BoundingSphere& b) {
            if (b.radius < best.radius)
                best = b;
        };
        for (const Expression& part : parts) {
            if (part.kind == Expression::Kind::literal)
                offer(around_literal(part, halves));
            else
                offer(around(part));
        }
        if (!(best.radius < infinity))
            offer(around_polyhedron(halves));
        return best;
    }

    [[nodiscard]] std::optional<HalfSpace> half_space(const Expression& e) const {
        const std::size_t first = s_.spheres.size();
        if (e.kind != Expression::Kind::literal || e.surface < first ||
            e.surface >= first + s_.planes.size())
            return std::nullopt;
        const PlaneSurface& plane = s_.planes[e.surface - first];
        const Vec3 normal = vec(plane.normal);
        return e.negated ? HalfSpace{-normal, -plane.distance} : HalfSpace{normal, plane.distance};
    }

    [[nodiscard]] BoundingSphere around_literal(const Expression& e,
                                                const std::vector<HalfSpace>& halves) const {
        if (e.negated)
            return {{}, infinity};
        std::size_t i = e.surface;
        if (i < s_.spheres.size())
            return widened({vec(s_.spheres[i].center), s_.spheres[i].radius});
        i -= s_.spheres.size();
        if (i < s_.planes.size())
            return {{}, infinity};
        i -= s_.planes.size();
        const Axis axis = i < s_.cylinders.size() ? axis_of(s_.cylinders[i])
                                                  : axis_of(s_.cones[i - s_.cylinders.size()]);
        Range range;
        for (const HalfSpace& half : halves)
            axis.limit(range, half);
        return axis.around(range);
    }

    static Axis axis_of(const CylinderSurface& c) {
        return {vec(c.origin), vec(c.axis), c.radius, 0};
    }
    static Axis axis_of(const ConeSurface& c) { return {vec(c.origin), vec(c.axis), 0, c.slope}; }

    const SurfaceCollector::Sorted& s_;
};

} // namespace

BoundingSphere bounding_sphere(const Expression& e, const SurfaceCollector::Sorted& surfaces) {
    const BoundingSphere b = Bounder(surfaces).around(e);
    const bool sound = is_finite(b.center) && !std::isnan(b.radius);
    return sound ? b : BoundingSphere{{}, infinity}; // absurd numbers
}

namespace {

Holds opposite(Holds h) {
    return h == Holds::never ? Holds::always : h == Holds::always ? Holds::never : h;
}

} // namespace

Holds holds_throughout(const BoundingSphere& places, const Expression& e,
                       const SurfaceCollector::Sorted& surfaces) {
    switch (e.kind) {
    case Expression::Kind::never:
        return Holds::never;
    case Expression::Kind::always:
        return Holds::always;
    case Expression::Kind::literal: {
        const auto [side, error] = surfaces.side_of(e.surface, places.center);
        const double margin = places.radius + error;
        const Holds inside = side > margin    ? Holds::never
                             : side < -margin ? Holds::always
                                              : Holds::sometimes;
        return e.negated ? opposite(inside) : inside;
    }
    case Expression::Kind::all:
    case Expression::Kind::any:
        break;
    }
    const bool all = e.kind == Expression::Kind::all;
    Holds result = all ? Holds::always : Holds::never;
    for (const Expression& part : e.parts) {
        const Holds h = holds_throughout(places, part, surfaces);
        result = all ? std::min(result, h) : std::max(result, h);
    }
    return result;
}

} // namespace fraja::kernel
