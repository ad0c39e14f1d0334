// A crossing with all its digits: once per hit that counts.
//
// From the numbers of the scene and the ray as they are (a direction is not exactly unit), in
// double-double arithmetic up to the last rounding, or, where that is as good, with compensated
// sums: planes, and spheres that are not too near. A place on a sphere or a cylinder is put back on
// it; a normal comes from the hit's place relative to the surface, never from world space.
#pragma once

#include "common/render/kernel/tables.hpp"
#include "common/render/kernel/wide.hpp"

namespace fraja::kernel {
namespace {

/// A hit of wide rays with one surface.
struct WideHit {
    Wide t;
    Wide3 place;
    Wide3 normal; ///< unit, outwards
};

/// Which of the two crossings is meant.
struct Crossing {
    Mask outwards;   ///< from inside to outside
    Mask on_surface; ///< the ray starts on the surface: one of them is 0, the other is meant
};

FRAJA_WIDE Wide2 select(Mask m, Wide2 yes, Wide2 no) {
    return {select(m, yes.high, no.high), select(m, yes.low, no.low)};
}
FRAJA_WIDE Wide2 not_negative(Wide2 a) {
    return {select(a.high > 0, a.high, Wide{}), select(a.high > 0, a.low, Wide{})};
}
FRAJA_WIDE Wide2 exact(double x) {
    return {all_lanes(x), Wide{}};
}
FRAJA_WIDE Wide2 exact(const double (&x)[2]) {
    return {all_lanes(x[0]), all_lanes(x[1])};
}
/// origin + t * dir, as if computed with twice the digits.
FRAJA_WIDE Wide point_at(Wide origin, Wide dir, Wide2 t) {
    const Wide2 way = two_product(t.high, dir);
    const Wide2 sum = two_sum(origin, way.high);
    return sum.high + (sum.low + (way.low + t.low * dir));
}
FRAJA_WIDE Wide3 point_at(Wide3 origin, Wide3 dir, Wide2 t) {
    return {point_at(origin.x, dir.x, t), point_at(origin.y, dir.y, t),
            point_at(origin.z, dir.z, t)};
}
FRAJA_WIDE Wide time_of(Wide2 t) {
    return greater(rounded(t), Wide{});
}

/// t of the near or far end of a chord, middle -+ half, of what is inside between them. Of a ray
/// that starts on the surface the other end than 0.
FRAJA_WIDE Wide2 chord_end(Wide2 middle, Wide2 half, Crossing crossing) {
    const Wide2 signed_half = select(crossing.outwards, half, -half);
    return middle + select(crossing.on_surface, middle, signed_half);
}

/// A sphere in each lane.
struct WideSphere {
    Wide3 center;
    Wide radius;
};

/// In double-double arithmetic throughout: for starts so near that t is lost otherwise.
[[gnu::noinline]] WideHit near_hit_on(const WideSphere& s, Wide3 origin, Wide3 dir,
                                      Crossing crossing) {
    const Wide3 center = s.center;
    const Wide32 f = difference(origin, center);
    const Wide2 a = dot2(dir, dir);
    const Wide2 middle = -(dot(f, dir) / a);
    const Wide32 nearest = f + middle * dir;
    const Wide r = s.radius;
    const Wide2 half = square_root(not_negative((two_product(r, r) - dot(nearest, nearest)) / a));
    const Wide2 t = chord_end(middle, half, crossing);
    const Wide3 normal = normalized(rounded(f + t * dir));
    return {time_of(t), center + r * normal, normal};
}

/// The part of `f` across `dir`, which need not be quite unit: f - middle * dir, without
/// cancellation; and middle itself.
struct Across {
    Wide3 nearest;
    Wide middle;
};
FRAJA_WIDE Across across(Wide32 f, Wide3 dir) {
    const Wide2 along = compensated_dot(f, dir);
    // middle = along / |dir|^2, of which |dir|^2 is 1 but for the last bits.
    const Wide excess = excess_over_one(dir);
    const Wide high = along.high;
    const Wide low = along.low - high * excess;
    const auto part = [&](Wide2 c, Wide d) {
        const Wide2 p = two_product(high, d);
        return (c.high - p.high) + ((c.low - p.low) - low * d);
    };
    return {{part(f.x, dir.x), part(f.y, dir.y), part(f.z, dir.z)}, high + low};
}

FRAJA_WIDE WideHit hit_on(const WideSphere& s, Wide3 origin, Wide3 dir, Crossing crossing) {
    const Wide3 center = s.center;
    const Across a = across(difference(origin, center), dir);
    const Wide r = s.radius;
    const Wide half = select(crossing.on_surface, -a.middle,
                             square_root(greater(r * r - dot(a.nearest, a.nearest), Wide{})));
    const Wide signed_half = select(crossing.outwards | crossing.on_surface, half, -half);
    const Wide t = signed_half - a.middle;
    const Wide3 normal = normalized(a.nearest + signed_half * dir);
    WideHit hit{greater(t, Wide{}), center + r * normal, normal};
    const Mask near = (2 * t < r) & ~crossing.on_surface;
    if (any(near)) {
        const WideHit exact = near_hit_on(s, origin, dir, crossing);
        hit = {select(near, exact.t, hit.t), select(near, exact.place, hit.place),
               select(near, exact.normal, hit.normal)};
    }
    return hit;
}

FRAJA_WIDE WideHit hit_on(const SphereSurface& s, Wide3 origin, Wide3 dir, Crossing crossing) {
    return hit_on(WideSphere{all_lanes3(s.center), all_lanes(s.radius)}, origin, dir, crossing);
}

FRAJA_WIDE WideHit hit_on(const PlaneSurface& s, Wide3 origin, Wide3 dir, Crossing) {
    const Wide3 direction = all_lanes3(s.direction);
    const Wide2 t = compensated_dot(difference(all_lanes3(s.point), origin), direction) /
                    compensated_dot(exactly(dir), direction);
    return {time_of(t), point_at(origin, dir, t), all_lanes3(s.normal)};
}

FRAJA_WIDE WideHit hit_on(const CylinderSurface& s, Wide3 origin, Wide3 dir, Crossing crossing) {
    const Wide3 axis = all_lanes3(s.direction);
    const Wide2 axis_squared = exact(s.direction_squared);
    const Wide32 f = difference(origin, all_lanes3(s.origin));
    const Wide32 across_f = f - (dot(f, axis) / axis_squared) * axis;
    const Wide32 across_dir = exactly(dir) - (dot2(dir, axis) / axis_squared) * axis;
    const Wide2 a = dot(across_dir, across_dir);
    const Wide2 middle = -(dot(across_f, across_dir) / a);
    const Wide32 nearest = across_f + middle * across_dir;
    const Wide r = all_lanes(s.radius);
    const Wide2 half = square_root(not_negative((two_product(r, r) - dot(nearest, nearest)) / a));
    const Wide2 t = chord_end(middle, half, crossing);
    const Wide32 across = across_f + t * across_dir;
    const Wide3 normal = normalized(rounded(across));
    // A start that lies a rounding off the surface must not hand its error on.
    const Wide off = rounded(two_product(r, r) - dot(across, across)) / (2 * r);
    const Wide3 place = rounded((exactly(origin) + t * dir) + exactly(off * normal));
    return {time_of(t), place, normal};
}

FRAJA_WIDE WideHit hit_on(const ConeSurface& s, Wide3 origin, Wide3 dir, Crossing crossing) {
    const Wide3 axis = all_lanes3(s.direction);
    const Wide2 k = exact(s.scaled_cosine);
    const Wide32 f = difference(origin, all_lanes3(s.origin));
    const Wide2 along_f = dot(f, axis);
    const Wide2 along_dir = dot2(dir, axis);
    const Wide2 a = k * dot2(dir, dir) - along_dir * along_dir;
    const Wide2 b = k * dot(f, dir) - along_dir * along_f;
    const Wide2 c =
        select(crossing.on_surface, Wide2{Wide{}, Wide{}}, k * dot(f, f) - along_f * along_f);
    const Wide2 root =
        select(crossing.on_surface, Wide2{magnitude(b.high), b.high < 0 ? -b.low : b.low},
               square_root(not_negative(b * b - a * c)));
    const Wide2 q = select(b.high < 0, root - b, -(root + b));
    const Wide2 one = q / a;
    const Wide2 other = select(q.high == 0, Wide2{Wide{}, Wide{}}, c / q);
    const Mask far = crossing.outwards ^ (a.high < 0); // steeper than the cone: from nappe to nappe
    const Wide2 by_order = select(far ^ (one.high > other.high), other, one);
    const Wide2 t = select(crossing.on_surface, one, by_order);
    const Wide32 local = f + t * dir;
    const Wide2 along = dot(local, axis);
    const Wide3 gradient = rounded(k * local - along * axis);
    const Wide3 unit = normalized(gradient);
    const Mask proper = dot(unit, unit) > 0.5; // not at the tip
    return {time_of(t), point_at(origin, dir, t), select(proper, unit, all_lanes3(s.axis))};
}

} // namespace
} // namespace fraja::kernel
