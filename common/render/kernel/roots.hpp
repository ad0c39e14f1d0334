// Where a ray crosses a surface, quickly: good enough to find the order of crossings. The one that
// counts is computed again, with all its digits, by refine.hpp.
//
// No epsilon. Which side of a surface a ray starts on is known (Rays::inside), not computed, and a
// ray that starts on a surface knows that, too: of its two roots, one is exactly 0. Where rounding
// makes a root contradict the side, the side is right, and the root is clamped to the start.
//
// Formulas: sphere, E. Haines et al., "Precision Improvements for Ray/Sphere Intersection", Ray
// Tracing Gems (2019); cylinder and cone likewise from the distance between ray and axis, with
// disc = det(B^2 - AC) in Lagrange's form.
#pragma once

#include "common/render/kernel/tables.hpp"
#include "common/render/kernel/wide.hpp"

namespace fraja::kernel {
namespace {

FRAJA_WIDE Wide never() {
    return all_lanes(__builtin_inf());
}

/// Wide rays: origin + t * dir.
struct WideRays {
    Wide3 origin, dir;
    WideInt owner; ///< the surface a ray starts on; none
};

/// A ray crosses a surface twice at most; never() where it does not.
struct Crossings {
    Wide first, second;
};

/// The roots of a t^2 + 2 b t + c, and how they lie. Inside is where it is negative.
struct Roots {
    Wide low, high;   ///< low <= high
    Wide middle_sign; ///< its sign is that of (low + high) / 2
    Mask real;        ///< there are any
    Mask between_is_inside;
};

/// The crossings of a ray that starts inside (or not) and on the surface (or not).
///
/// Where the space between the roots is on the start's side, the ray leaves it at the high one;
/// where it is on the other side, the ray has both before it or none, as their middle says.
FRAJA_WIDE Crossings crossings(const Roots& r, Mask inside, Mask on_surface) {
    const Mask starts_between = ~(inside ^ r.between_is_inside);
    const Wide leaves = greater(select(r.real, r.high, Wide{}), Wide{});
    const Mask ahead = r.real & (r.middle_sign > 0) & ~on_surface;
    const Wide first =
        select(starts_between, leaves, select(ahead, greater(r.low, Wide{}), never()));
    return {first, select(~starts_between & ahead, greater(r.high, Wide{}), never())};
}

struct HalfChord {
    Wide middle;  ///< t nearest to the axis or centre
    Wide squared; ///< of half the chord, times |dir|^2; negative: no hit
};

FRAJA_WIDE HalfChord half_chord(const SphereSurface& s, const WideRays& ray) {
    const Wide3 f = ray.origin - all_lanes3(s.center);
    const Wide b = dot(f, ray.dir);
    const Wide3 nearest = f - b * ray.dir;
    return {-b, s.radius * s.radius - dot(nearest, nearest)};
}

FRAJA_WIDE Roots roots_of(const SphereSurface& s, const WideRays& ray, Mask on_surface) {
    const HalfChord chord = half_chord(s, ray);
    const Mask real = (chord.squared >= 0) | on_surface;
    const Wide half =
        select(on_surface, magnitude(chord.middle), square_root(greater(chord.squared, Wide{})));
    return {chord.middle - half, chord.middle + half, chord.middle, real, ~Mask{}};
}

/// a t^2 + 2 b t + c, of which the discriminant b^2 - a c is computed in Lagrange's form, and c
/// only where it is needed.
struct Quadratic {
    Wide a, b, discriminant;
};

FRAJA_WIDE Quadratic quadratic_of(const CylinderSurface& s, const WideRays& ray) {
    const Wide3 axis = all_lanes3(s.axis);
    const Wide3 f = ray.origin - all_lanes3(s.origin);
    const Wide3 n = cross(ray.dir, axis);
    const Wide a = dot(n, n);
    const Wide w = dot(f, n);
    const Wide b = dot(f, ray.dir) - dot(f, axis) * dot(ray.dir, axis);
    return {a, b, (s.radius * s.radius) * a - w * w};
}

FRAJA_WIDE Roots roots_of(const CylinderSurface& s, const WideRays& ray, Mask on_surface) {
    const Quadratic q = quadratic_of(s, ray);
    const Mask real = ((q.discriminant >= 0) | on_surface) & (q.a > 0);
    const Wide half =
        select(on_surface, magnitude(q.b), square_root(greater(q.discriminant, Wide{})));
    const Wide per_a = 1.0 / q.a;
    // Parallel to the axis it never leaves: an inside ray's way out is infinitely far.
    return {select(real, (-q.b - half) * per_a, never()),
            select(real, (half - q.b) * per_a, never()), -q.b, real | (q.a == 0), ~Mask{}};
}

FRAJA_WIDE Wide entry_of(const CylinderSurface& s, std::int64_t index, const WideRays& ray) {
    const Quadratic q = quadratic_of(s, ray);
    const Mask hit =
        (q.discriminant >= 0) & (q.b < 0) & (q.a > 0) & (ray.owner != all_lanes(index));
    if (!any(hit))
        return never();
    const Wide half = square_root(greater(q.discriminant, Wide{}));
    return select(hit, greater((-q.b - half) * (1.0 / q.a), Wide{}), never());
}

/// Likewise, and what else its roots are made of.
struct ConeQuadratic : Quadratic {
    Wide3 from_axis;          ///< f x axis, f the start from the tip
    Wide slope_along_squared; ///< (slope * f . axis)^2
    /// The constant term; negative inside.
    [[nodiscard]] Wide c() const { return dot(from_axis, from_axis) - slope_along_squared; }
};

FRAJA_WIDE ConeQuadratic quadratic_of(const ConeSurface& s, const WideRays& ray) {
    const Wide3 axis = all_lanes3(s.axis);
    const Wide3 f = ray.origin - all_lanes3(s.origin);
    const Wide3 n = cross(ray.dir, axis);
    const Wide along_dir = dot(ray.dir, axis);
    const Wide along_f = dot(f, axis);
    const Wide3 e = along_dir * f - along_f * ray.dir;
    const Wide3 g = cross(f, axis);
    const Wide w = dot(f, n);
    return {{dot(n, n) - s.slope_squared * (along_dir * along_dir),
             dot(g, n) - s.slope_squared * (along_dir * along_f),
             s.slope_squared * dot(e, e) - w * w},
            g,
            s.slope_squared * (along_f * along_f)};
}

FRAJA_WIDE Roots roots_of(const ConeSurface& s, const WideRays& ray, Mask on_surface) {
    const ConeQuadratic k = quadratic_of(s, ray);
    const Wide c = select(on_surface, Wide{}, k.c());
    // A ray that is steeper than the cone goes from nappe to nappe, if only through the tip.
    const Mask opens = k.a < 0;
    const Mask real = (k.discriminant >= 0) | opens | on_surface;
    const Wide half =
        select(on_surface, magnitude(k.b), square_root(greater(k.discriminant, Wide{})));
    const Wide q = select(k.b < 0, half - k.b, -k.b - half);
    const Wide one = q / k.a;
    const Wide other = select(q == 0, Wide{}, c / q);
    // |one| >= |other|: which is lower is told by signs, not by roundings.
    const Mask other_is_lower = (k.b < 0) ^ opens;
    return {select(other_is_lower, other, one), select(other_is_lower, one, other),
            select(opens, k.b, -k.b), real, ~opens};
}

/// Of a ray that starts outside: a flat one goes in where its nearer root is, if that is ahead, a
/// steep one on the other side of the tip, or where it meets the nappe it goes along.
FRAJA_WIDE Wide entry_of(const ConeSurface& s, std::int64_t index, const WideRays& ray) {
    const ConeQuadratic k = quadratic_of(s, ray);
    const Mask on_surface = ray.owner == all_lanes(index);
    const Mask steep = k.a < 0;
    const Mask towards = (k.b < 0) & ~on_surface;
    const Mask hit = steep | (towards & (k.discriminant >= 0)); // a steep one always has roots
    if (!any(hit))
        return never();
    const Wide half =
        select(on_surface, magnitude(k.b), square_root(greater(k.discriminant, Wide{})));
    // The roots are q / a and c / q.
    const Wide q = select(towards, half - k.b, -magnitude(k.b) - half);
    const Mask leaves_at_once = on_surface & (k.b < 0); // if rounding makes it
    const Wide t = select(leaves_at_once, Wide{},
                          select(towards, greater(k.c(), Wide{}), q) / select(towards, q, k.a));
    return select(hit, greater(t, Wide{}), never());
}

template <class Surface>
FRAJA_WIDE Crossings crossings_of(const Surface& s, std::int64_t index, const WideRays& ray,
                                  Mask inside) {
    const Mask on_surface = ray.owner == all_lanes(index);
    return crossings(roots_of(s, ray, on_surface), inside, on_surface);
}

FRAJA_WIDE Crossings crossings_of(const PlaneSurface& s, std::int64_t index, const WideRays& ray,
                                  Mask inside) {
    const Wide3 normal = all_lanes3(s.normal);
    const Wide facing = dot(normal, ray.dir);
    const Mask crosses = (inside ? facing > 0 : facing < 0) & (ray.owner != all_lanes(index));
    const Wide t = (s.distance - dot(normal, ray.origin)) / facing;
    return {select(crosses, greater(t, Wide{}), never()), never()};
}

/// Of rays that carry no state: on which side they start is told by the roots, too.
struct SidedCrossings {
    Crossings crossings;
    Mask inside;
};

template <class Surface>
FRAJA_WIDE SidedCrossings sided_crossings_of(const Surface& s, std::int64_t index,
                                             const WideRays& ray) {
    const Mask on_surface = ray.owner == all_lanes(index);
    const Roots roots = roots_of(s, ray, on_surface);
    const Mask between = roots.real & (roots.low <= 0) & (roots.high > 0);
    const Mask inside = ~(between ^ roots.between_is_inside);
    return {crossings(roots, inside, on_surface), inside};
}

FRAJA_WIDE SidedCrossings sided_crossings_of(const PlaneSurface& s, std::int64_t index,
                                             const WideRays& ray) {
    const Wide3 normal = all_lanes3(s.normal);
    const Wide facing = dot(normal, ray.dir);
    const Wide above = dot(normal, ray.origin) - s.distance;
    const Wide t = -above / facing;
    // Along the plane it never does, though above / 0 may be infinite of either sign.
    const Mask crosses = (t > 0) & (facing != 0) & (ray.owner != all_lanes(index));
    const Mask inside = crosses ? facing > 0 : (facing < 0) | ((facing == 0) & (above < 0));
    return {{select(crosses, t, never()), never()}, inside};
}

/// Where a ray that is outside enters, for rays that are outside of everything.
FRAJA_WIDE Wide entry_of(const SphereSurface& s, std::int64_t index, const WideRays& ray) {
    const HalfChord chord = half_chord(s, ray);
    const Mask hit = (chord.squared >= 0) & (chord.middle > 0) & (ray.owner != all_lanes(index));
    if (!any(hit))
        return never();
    const Wide low = chord.middle - square_root(greater(chord.squared, Wide{}));
    return select(hit, greater(low, Wide{}), never());
}
FRAJA_WIDE Wide entry_of(const PlaneSurface& s, std::int64_t index, const WideRays& ray) {
    return crossings_of(s, index, ray, Mask{}).first;
}

// ---------------------------------------------------------------- on which side a ray's start lies

/// Negative inside, 0 on the surface.
FRAJA_WIDE Wide side_of(const SphereSurface& s, Wide3 p) {
    const Wide3 f = p - all_lanes3(s.center);
    return square_root(dot(f, f)) - s.radius;
}
FRAJA_WIDE Wide side_of(const PlaneSurface& s, Wide3 p) {
    return dot(all_lanes3(s.normal), p - all_lanes3(s.point));
}
FRAJA_WIDE Wide side_of(const CylinderSurface& s, Wide3 p) {
    const Wide3 g = cross(p - all_lanes3(s.origin), all_lanes3(s.axis));
    return square_root(dot(g, g)) - s.radius;
}
FRAJA_WIDE Wide side_of(const ConeSurface& s, Wide3 p) {
    const Wide3 f = p - all_lanes3(s.origin);
    const Wide3 axis = all_lanes3(s.axis);
    const Wide3 g = cross(f, axis);
    return square_root(dot(g, g)) - s.slope * magnitude(dot(f, axis));
}

/// Outwards, of any length.
FRAJA_WIDE Wide3 slope_of(const SphereSurface& s, Wide3 p) {
    return p - all_lanes3(s.center);
}
FRAJA_WIDE Wide3 slope_of(const PlaneSurface& s, Wide3) {
    return all_lanes3(s.normal);
}
FRAJA_WIDE Wide3 slope_of(const CylinderSurface& s, Wide3 p) {
    const Wide3 f = p - all_lanes3(s.origin);
    const Wide3 axis = all_lanes3(s.axis);
    return f - dot(f, axis) * axis;
}
FRAJA_WIDE Wide3 slope_of(const ConeSurface& s, Wide3 p) {
    const Wide3 f = p - all_lanes3(s.origin);
    const Wide3 axis = all_lanes3(s.axis);
    const Wide along = dot(f, axis);
    return f - ((1 + s.slope_squared) * along) * axis;
}

/// Where a ray starts that has no owner. On a surface, the side it goes to.
template <class Surface>
FRAJA_WIDE Mask starts_inside(const Surface& s, Wide3 origin, Wide3 dir) {
    const Wide side = side_of(s, origin);
    return (side < 0) | ((side == 0) & (dot(slope_of(s, origin), dir) < 0));
}

} // namespace
} // namespace fraja::kernel
