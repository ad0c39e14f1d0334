#include "tests/stress/surface_cases.hpp"

#include "common/render/kernel/refine.hpp"
#include "common/render/kernel/roots.hpp"
#include "common/render/kernel/surfaces.hpp"
#include "tests/stress/lanes.hpp"
#include "tests/stress/quad.hpp"
#include "tests/stress/random_vectors.hpp"

#include <bit>
#include <cmath>
#include <numbers>

namespace fraja::stress {
namespace {

using kernel::Mask;
using kernel::Wide3;

Vec3 lane_of(const Wide3& v) {
    return {v.x[0], v.y[0], v.z[0]};
}

/// The truth about a form: where a line crosses it, its normal, and how far off it a place is.
struct Chord {
    Quad low, high; ///< t of its ends
};

/// What is nearer to a point than a radius. From the point of the line that is nearest: even 113
/// bits are not enough for b^2 - a c from 1e10 radii away.
Chord chord(const Quad3& f, const Quad3& d, double radius) {
    const Quad a = dot(d, d), middle = -dot(f, d) / a;
    const Quad3 nearest = f + middle * d;
    const Quad half = root((Quad{radius} * radius - dot(nearest, nearest)) / a);
    // The end that is near the start, if one is, without cancellation.
    const Quad far = middle < 0 ? middle - half : middle + half;
    const Quad near = (dot(f, f) - Quad{radius} * radius) / a / far;
    return near < far ? Chord{near, far} : Chord{far, near};
}

struct TrueSphere {
    Sphere s;
    [[nodiscard]] Chord ends(const Quad3& o, const Quad3& d) const {
        return chord(o - quad(s.center), d, s.radius);
    }
    Quad3 normal(const Quad3& p) const { return unit(p - quad(s.center)); }
    Quad off(const Quad3& p) const { return length(p - quad(s.center)) - s.radius; }
};
struct TrueCylinder {
    Cylinder s;
    [[nodiscard]] Chord ends(const Quad3& o, const Quad3& d) const {
        return chord(across(o - quad(s.origin), quad(s.direction)), across(d, quad(s.direction)),
                     s.radius);
    }
    Quad3 normal(const Quad3& p) const {
        return unit(across(p - quad(s.origin), quad(s.direction)));
    }
    Quad off(const Quad3& p) const {
        return length(across(p - quad(s.origin), quad(s.direction))) - s.radius;
    }
};
struct TrueCone {
    Cone s;
    [[nodiscard]] Quad cosine_squared() const {
        const long double c = std::cos(static_cast<long double>(s.angle_rad)); // 64 bits will do
        return Quad{c} * c;
    }
    /// a t^2 + 2 b t + c, 0 on the surface.
    struct Coefficients {
        Quad a, b, c;
        [[nodiscard]] Quad discriminant() const { return b * b - a * c; }
    };
    [[nodiscard]] Coefficients coefficients(const Quad3& o, const Quad3& d) const {
        const Quad3 axis = quad(s.direction), f = o - quad(s.origin);
        const Quad k = cosine_squared() * dot(axis, axis);
        const Quad sd = dot(d, axis), sf = dot(f, axis);
        return {k * dot(d, d) - sd * sd, k * dot(f, d) - sd * sf, k * dot(f, f) - sf * sf};
    }
    [[nodiscard]] Chord ends(const Quad3& o, const Quad3& d) const {
        const Coefficients k = coefficients(o, d);
        const Quad half = root(k.discriminant());
        const Quad q = k.b < 0 ? half - k.b : -half - k.b;
        const Quad one = q / k.a, other = k.c / q;
        return one < other ? Chord{one, other} : Chord{other, one};
    }
    Quad3 normal(const Quad3& p) const {
        const Quad3 axis = quad(s.direction), f = p - quad(s.origin);
        return unit((cosine_squared() * dot(axis, axis)) * f - dot(f, axis) * axis);
    }
    Quad off(const Quad3& p) const {
        const Quad3 axis = unit(quad(s.direction)), f = p - quad(s.origin);
        const Quad along = magnitude(dot(f, axis)), side = length(across(f, axis));
        const Quad c = root(cosine_squared());
        return side * c - along * root(1 - c * c);
    }
};

struct Ray {
    Vec3 origin, dir;
    bool inside = false; ///< it starts within the form
};

void take(double& most, Quad error) {
    most = std::max(most, static_cast<double>(error / Quad{eps}));
}

/// One ray that crosses the form, from outside or inside.
template <class True, class Surface>
void check(Errors& e, const True& form, const Surface& surface, const Ray& ray, double scale) {
    const Mask inside = ray.inside ? ~Mask{} : Mask{}, nowhere{};
    const kernel::WideRays rays{in_all_lanes(ray.origin), in_all_lanes(ray.dir),
                                kernel::all_lanes(std::int64_t{kernel::none})};
    const double quick = kernel::crossings_of(surface, 7, rays, inside).first[0];
    const kernel::WideHit hit = kernel::hit_on(surface, rays.origin, rays.dir, {inside, nowhere});
    ++e.cases;
    const Chord ends = form.ends(quad(ray.origin), quad(ray.dir));
    const Quad t = ray.inside ? ends.high : ends.low;
    if (!(quick < 1e300))
        ++e.missed;
    take(e.t, magnitude(Quad{hit.t[0]} - t) / t);
    take(e.place, magnitude(form.off(quad(lane_of(hit.place)))) / scale);
    const Quad3 truly = form.normal(quad(ray.origin) + t * quad(ray.dir));
    take(e.normal, length(quad(lane_of(hit.normal)) - truly));
}

template <class Form>
auto surface_of(const Form& form) {
    kernel::SurfaceCollector collector{Vec3{}};
    (void)collector.add(fraja::Form(form), false);
    const auto sorted = collector.sorted();
    if constexpr (std::is_same_v<Form, Sphere>)
        return sorted.spheres.front();
    else if constexpr (std::is_same_v<Form, Cylinder>)
        return sorted.cylinders.front();
    else if constexpr (std::is_same_v<Form, Cone>)
        return sorted.cones.front();
    else
        return sorted.planes.front();
}

// ---------------------------------------------------------------------------------------- spheres

/// A ray to a point within a sphere, no nearer to its rim than a tenth of the radius.
Vec3 towards_inner(Rng& rng, const Sphere& s, const Vec3& origin) {
    const Vec3 way = normalized(s.center - origin);
    const Vec3 aside = cross(way, direction(rng));
    return normalized(s.center + (rng.between(0, 0.9) * s.radius) * normalized(aside) - origin);
}

template <int low_exponent, int high_exponent>
Errors sphere_from_outside(Rng& rng, std::uint64_t cases) {
    Errors e;
    while (e.cases < cases) {
        const Sphere s{direction(rng) * rng.between(0, 3), magnitude_between(rng, -2, 2)};
        const double distance = magnitude_between(rng, low_exponent, high_exponent) + 0.5;
        const Vec3 origin = s.center + (distance * s.radius) * direction(rng);
        check(e, TrueSphere{s}, surface_of(s), {origin, towards_inner(rng, s, origin)},
              length(s.center) + s.radius);
    }
    return e;
}

Errors sphere_from_inside(Rng& rng, std::uint64_t cases) {
    Errors e;
    while (e.cases < cases) {
        const Sphere s{direction(rng) * rng.between(0, 3), magnitude_between(rng, -2, 2)};
        const Vec3 origin = s.center + (rng.between(0, 0.9) * s.radius) * direction(rng);
        check(e, TrueSphere{s}, surface_of(s), {origin, direction(rng), true},
              length(s.center) + s.radius);
    }
    return e;
}

Errors sphere_far_from_the_origin(Rng& rng, std::uint64_t cases) {
    Errors e;
    while (e.cases < cases) {
        const Sphere s{direction(rng) * 1e8, rng.between(0.5, 5)};
        const Vec3 origin = s.center + (rng.between(1.5, 10) * s.radius) * direction(rng);
        check(e, TrueSphere{s}, surface_of(s), {origin, towards_inner(rng, s, origin)}, 1e8);
    }
    return e;
}

Errors sphere_close(Rng& rng, std::uint64_t cases) {
    Errors e;
    while (e.cases < cases) {
        const Sphere s{direction(rng) * rng.between(0, 3), magnitude_between(rng, -1, 1)};
        const Vec3 up = direction(rng);
        const Vec3 origin = s.center + (s.radius * (1 + magnitude_between(rng, -10, -3))) * up;
        if (!(length(origin - s.center) > s.radius))
            continue; // rounded onto it
        const Vec3 dir = normalized(direction(rng) - 1.5 * up);
        check(e, TrueSphere{s}, surface_of(s), {origin, dir}, length(s.center) + s.radius);
    }
    return e;
}

Errors sphere_giant(Rng& rng, std::uint64_t cases) {
    Errors e;
    while (e.cases < cases) {
        const Vec3 up = direction(rng);
        const double radius = magnitude_between(rng, 5, 8);
        const Sphere s{-radius * up, radius};
        const Vec3 origin = rng.between(1, 10) * up;
        const Vec3 dir = normalized(direction(rng) - 1.5 * up);
        check(e, TrueSphere{s}, surface_of(s), {origin, dir}, radius);
    }
    return e;
}

// ---------------------------------------------------------------------- cylinders, cones, planes

Vec3 across_to(const Vec3& axis, Rng& rng) {
    return normalized(cross(axis, direction(rng)));
}

template <int low_exponent, int high_exponent>
Errors cylinder_from_outside(Rng& rng, std::uint64_t cases) {
    Errors e;
    while (e.cases < cases) {
        const Vec3 axis = direction(rng) * rng.between(0.1, 10);
        const Cylinder s{direction(rng), axis, magnitude_between(rng, -1, 1)};
        const double distance = magnitude_between(rng, low_exponent, high_exponent) + 0.5;
        const Vec3 out = across_to(axis, rng);
        const Vec3 origin = s.origin + (distance * s.radius) * out + rng.between(-3, 3) * axis;
        const Vec3 target = s.origin +
                            (rng.between(-0.9, 0.9) * s.radius) * normalized(cross(axis, out)) +
                            rng.between(-3, 3) * axis;
        check(e, TrueCylinder{s}, surface_of(s), {origin, normalized(target - origin)},
              length(origin) + length(target));
    }
    return e;
}

Errors cylinder_along_its_axis(Rng& rng, std::uint64_t cases) {
    Errors e;
    while (e.cases < cases) {
        const Vec3 axis = direction(rng);
        const Cylinder s{direction(rng), axis, 1};
        const Vec3 origin = s.origin + rng.between(0, 0.9) * across_to(axis, rng);
        const double tilt = magnitude_between(rng, -9, -3);
        const Vec3 dir = normalized(axis + tilt * across_to(axis, rng));
        check(e, TrueCylinder{s}, surface_of(s), {origin, dir, true}, 1 / tilt);
    }
    return e;
}

/// From outside, to a place on the surface of one nappe, across.
Errors cone_from_outside(Rng& rng, std::uint64_t cases) {
    Errors e;
    while (e.cases < cases) {
        const Vec3 axis = direction(rng);
        const Cone s{direction(rng), axis * rng.between(0.1, 10), rng.between(0.1, 1.2)};
        const Vec3 out = across_to(axis, rng);
        const double height = rng.between(0.5, 5), side = height * std::tan(s.angle_rad);
        const Vec3 target = s.origin + height * axis +
                            (rng.between(-0.8, 0.8) * side) * normalized(cross(axis, out));
        const Vec3 origin = s.origin + height * axis + (side * rng.between(1.5, 10)) * out;
        check(e, TrueCone{s}, surface_of(s), {origin, normalized(target - origin)},
              length(s.origin) + 10 * side + height);
    }
    return e;
}

/// Past the tip of a cone, at a thousandth to a thousand-millionth of the way.
Errors cone_near_its_tip(Rng& rng, std::uint64_t cases) {
    Errors e;
    while (e.cases < cases) {
        const Vec3 axis = direction(rng);
        const Cone s{direction(rng), axis, rng.between(0.2, 1.0)};
        const Vec3 out = across_to(axis, rng);
        const double miss = magnitude_between(rng, -9, -3);
        const Vec3 target = s.origin + miss * axis;
        const Vec3 origin = target + rng.between(1, 5) * out;
        check(e, TrueCone{s}, surface_of(s), {origin, normalized(target - origin)},
              length(s.origin) + 5);
    }
    return e;
}

/// Along the wall of a cone, from outside: one of the roots is somewhere, the other nearly at
/// infinity, before or behind. How much depends on the rounding of the cone's angle.
Errors cone_along_its_wall(Rng& rng, std::uint64_t cases) {
    Errors e;
    while (e.cases < cases) {
        const Vec3 axis = direction(rng);
        const Cone s{direction(rng), axis, rng.between(0.2, 1.2)};
        const Vec3 out = across_to(axis, rng);
        const Vec3 wall = std::cos(s.angle_rad) * axis + std::sin(s.angle_rad) * out;
        const double off = magnitude_between(rng, -16, -4);
        const Vec3 dir = normalized(wall + off * direction(rng));
        const Vec3 aside = across_to(axis, rng);
        const Vec3 origin = s.origin + rng.between(0.5, 3) * axis + rng.between(4, 12) * aside;
        const TrueCone truth{s};
        if (truth.off(quad(origin)) < 0)
            continue;
        const Chord ends = truth.ends(quad(origin), quad(dir));
        const Quad t = magnitude(ends.low) < magnitude(ends.high) ? ends.low : ends.high;
        const Quad other = magnitude(ends.low) < magnitude(ends.high) ? ends.high : ends.low;
        ++e.cases;
        const kernel::WideRays rays{in_all_lanes(origin), in_all_lanes(dir),
                                    kernel::all_lanes(std::int64_t{kernel::none})};
        const double quick = kernel::crossings_of(surface_of(s), 7, rays, Mask{}).first[0];
        const bool crosses = truth.coefficients(quad(origin), quad(dir)).discriminant() >= 0;
        const bool expected = crosses && (t > 0 || other > 0);
        if (crosses && magnitude(other) > 1e8) { // there, rounding decides on which side
            if (t > 0)
                e.missed += !(magnitude(Quad{quick} - t) <= Quad{1e-4} * t);
            else
                e.missed += quick < 1e7;
        } else {
            e.missed += (quick < 1e300) != expected;
        }
    }
    return e;
}

Errors plane(Rng& rng, std::uint64_t cases) {
    Errors e;
    while (e.cases < cases) {
        const Vec3 normal = direction(rng) * rng.between(0.1, 10);
        const Vec3 up = normalized(normal);
        const Vec3 point = across_to(normal, rng) * magnitude_between(rng, -1, 6);
        const Plane s{point, normal};
        const Vec3 foot = across_to(normal, rng) * rng.between(0, 3);
        const Vec3 origin = foot + magnitude_between(rng, -6, 1) * up;
        const Vec3 dir = normalized(direction(rng) - 1.5 * up);
        const Quad height = dot(quad(origin) - quad(point), quad(normal));
        if (!(height > 0))
            continue; // the point is so far away that its rounding tilts the plane
        const Quad t = -height / dot(quad(normal), quad(dir));
        const kernel::PlaneSurface surface = surface_of(s);
        const kernel::WideRays rays{in_all_lanes(origin), in_all_lanes(dir),
                                    kernel::all_lanes(std::int64_t{kernel::none})};
        const double quick = kernel::crossings_of(surface, 7, rays, Mask{}).first[0];
        const kernel::WideHit hit =
            kernel::hit_on(surface, rays.origin, rays.dir, kernel::Crossing{});
        ++e.cases;
        e.missed += !(quick < 1e300);
        take(e.t, magnitude(Quad{hit.t[0]} - t) / t);
        const Quad off = dot(quad(lane_of(hit.place)) - quad(point), unit(quad(normal)));
        take(e.place, magnitude(off) / (length(quad(origin)) + t));
        take(e.normal, length(quad(lane_of(hit.normal)) - unit(quad(normal))));
    }
    return e;
}

/// One of the 15 balls.
std::uint64_t rays_that_leave(Rng& rng, std::uint64_t rays, double radius, double away) {
    const Sphere s{Vec3{away * radius, -away * radius, away * radius}, radius};
    const kernel::SphereSurface surface = surface_of(s);
    const Mask always = ~Mask{};
    const double scale = away * radius + radius;
    std::uint64_t left = 0;
    for (std::uint64_t i = 0; i < rays; ++i) {
        const Vec3 up = direction(rng), along = across_to(up, rng);
        const double grazing = magnitude_between(rng, -6, 0.17);
        kernel::WideRays ray{
            in_all_lanes(s.center + radius * up),
            in_all_lanes(normalized(std::cos(grazing) * along - std::sin(grazing) * up)),
            kernel::all_lanes(std::int64_t{7})};
        bool good = true;
        for (int bounce = 0; bounce < 500 && good; ++bounce) {
            const double quick = kernel::crossings_of(surface, 7, ray, always).first[0];
            const kernel::WideHit hit =
                kernel::hit_on(surface, ray.origin, ray.dir, {always, always});
            const Vec3 off = lane_of(hit.place) - s.center;
            good = quick > 0 && quick < 1e300 && hit.t[0] > 0 && hit.t[0] <= 2.1 * radius &&
                   std::abs(length(off) - radius) <= 16 * eps * scale;
            const kernel::Wide cosine = kernel::dot(hit.normal, ray.dir);
            ray.dir = kernel::normalized(ray.dir + (-2 * cosine) * hit.normal);
            ray.origin = hit.place;
        }
        left += good ? 0 : 1;
    }
    return left;
}

template <class Form>
std::uint64_t entry_differs(Rng& rng, const Form& form, const Vec3& origin, const Vec3& dir) {
    const auto surface = surface_of(form);
    const std::int64_t owner = rng.below(8) == 0 ? 7 : kernel::none;
    const kernel::WideRays rays{in_all_lanes(origin), in_all_lanes(dir), kernel::all_lanes(owner)};
    const double shorter = kernel::entry_of(surface, 7, rays)[0];
    const double general = kernel::crossings_of(surface, 7, rays, Mask{}).first[0];
    return std::bit_cast<std::uint64_t>(shorter) == std::bit_cast<std::uint64_t>(general) ? 0 : 1;
}

} // namespace

std::uint64_t entries_that_differ(Rng& rng, std::uint64_t rays) {
    std::uint64_t differ = 0;
    while (rays > 0) {
        const Vec3 axis = direction(rng), place = direction(rng);
        const Vec3 origin = place + rng.between(0, 6) * direction(rng);
        const Vec3 dir = normalized(
            place + (rng.below(2) == 0 ? magnitude_between(rng, -12, 0.5) : 0.0) * direction(rng) -
            origin);
        const auto count = [&](const auto& truth, const auto& form) {
            if (truth.off(quad(origin)) > 1e-12) {
                differ += entry_differs(rng, form, origin, dir);
                --rays;
            }
        };
        switch (rng.below(4)) {
        case 0: {
            const Sphere s{place, rng.between(0.1, 2)};
            count(TrueSphere{s}, s);
            break;
        }
        case 1: {
            const Cylinder s{place, axis, rng.between(0.1, 2)};
            count(TrueCylinder{s}, s);
            break;
        }
        case 2: {
            const Cone s{place, axis, rng.between(0.05, 1.5)};
            count(TrueCone{s}, s);
            break;
        }
        default:
            if (dot(origin - place, axis) > 0) {
                differ += entry_differs(rng, Plane{place, axis}, origin, dir);
                --rays;
            }
        }
    }
    return differ;
}

std::uint64_t rays_that_leave_a_mirror_ball(Rng& rng, std::uint64_t rays) {
    std::uint64_t left = 0;
    for (const double radius : {1e-9, 1e-3, 1.0, 1e3, 1e9})
        for (const double away : {0.0, 1e3, 1e6})
            left += rays_that_leave(rng, (rays + 14) / 15, radius, away);
    return left;
}

const std::vector<Regime>& surface_regimes() {
    static const std::vector<Regime> regimes{
        {"sphere, from 1.5 to 10 radii", {10, 4, 12}, sphere_from_outside<0, 1>},
        {"sphere, from 1e3 to 1e6 radii", {10, 4, 12}, sphere_from_outside<3, 6>},
        {"sphere, from 1e7 to 1e10 radii", {10, 4, 12}, sphere_from_outside<7, 10>},
        {"sphere, from inside", {10, 4, 12}, sphere_from_inside},
        {"sphere, 1e8 from the origin", {10, 4, 12}, sphere_far_from_the_origin},
        {"sphere, 1e-10 to 1e-3 radii above it", {400, 4, 12}, sphere_close},
        {"sphere of 1e5 to 1e8, seen from 1 to 10", {400, 4, 12}, sphere_giant},
        {"cylinder, from 1.5 to 10 radii", {10, 4, 12}, cylinder_from_outside<0, 1>},
        {"cylinder, from 1e3 to 1e6 radii", {10, 4, 12}, cylinder_from_outside<3, 6>},
        {"cylinder, along its axis (tilt 1e-9 to 1e-3)", {0, 4, 12}, cylinder_along_its_axis},
        {"cone, across", {10, 4, 12}, cone_from_outside},
        {"cone, 1e-9 to 1e-3 beside its tip", {0, 4, 0}, cone_near_its_tip},
        {"cone, along its wall (but for 1e-16 to 1e-4)", {}, cone_along_its_wall},
        {"plane, its point up to 1e6 away", {10, 4, 12}, plane},
    };
    return regimes;
}

} // namespace fraja::stress
