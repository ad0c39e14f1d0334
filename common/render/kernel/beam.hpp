// A beam: what some rays that go nearly the same way can touch, and what they cannot.
#pragma once

#include "common/render/kernel/tables.hpp"

#include <algorithm>

namespace fraja::kernel {
namespace {

/// All points within `radius + spread * z` of an axis, z along it from the start, from -radius to
/// length + radius.
struct Beam {
    double start[3], dir[3]; ///< unit
    double radius = 0, spread = 0, length = 0;

    static double dot(const double (&a)[3], const double (&b)[3]) {
        return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    }

    /// Whether the beam cannot touch a sphere. Never true of one whose radius is infinite.
    [[nodiscard]] bool misses(const double (&center)[3], double sphere_radius) const {
        if (sphere_radius < 0)
            return true;
        const double way[3] = {center[0] - start[0], center[1] - start[1], center[2] - start[2]};
        const double z = dot(way, dir), squared = dot(way, way);
        // Much more than rounding takes.
        const double slack = 1e-9 * (__builtin_fabs(z) + sphere_radius + radius) + 1e-300;
        const double reach = sphere_radius + radius + slack;
        if (z < -reach || z > length + reach)
            return true;
        const double ahead = z > 0 ? z : 0;
        const double limit = radius + spread * ahead + sphere_radius * (1 + spread) + slack;
        return squared - z * z > limit * limit + 1e-9 * squared;
    }

    /// Whether no ray of the beam can enter a half-space: all start outside, and none goes towards
    /// it far enough.
    [[nodiscard]] bool stays_outside(const PlaneSurface& plane) const {
        const double facing = dot(plane.normal, dir);
        const double height = height_above(plane);
        if (!(height > radius))
            return false;
        if (length < __builtin_inf()) // the far end, too
            return height + facing * length - radius - spread * length > 1e-9 * length;
        return facing > spread + 1e-9;
    }

    /// Whether every ray of the beam, which has no end, enters a half-space: all start outside and
    /// go towards it.
    [[nodiscard]] bool surely_meets(const PlaneSurface& plane) const {
        return height_above(plane) > radius && dot(plane.normal, dir) < -spread - 1e-9;
    }

private:
    /// Of the start; less than it is.
    [[nodiscard]] double height_above(const PlaneSurface& plane) const {
        const double way[3] = {start[0] - plane.point[0], start[1] - plane.point[1],
                               start[2] - plane.point[2]};
        const double slack = 1e-9 * (__builtin_fabs(way[0]) + __builtin_fabs(way[1]) +
                                     __builtin_fabs(way[2]) + radius);
        return dot(plane.normal, way) - slack;
    }
};

/// The rays through a rectangle of the screen, all of which is 0 to 1 both ways (its edges are part
/// of it); false where nothing useful is known of them: they spread too far, or start at two eyes.
inline bool beam_through(const CameraTable& camera, const double (&across)[2],
                         const double (&down)[2], Beam& beam) {
    if (camera.stereo && across[0] < 0.5 && across[1] >= 0.5)
        return false;
    const bool right_eye = camera.stereo && across[0] >= 0.5;
    struct Way {
        double v[3], length;
    };
    // From the eye to the screen; stereo eyes look the same way.
    const auto way_to = [&](double x, double y) {
        const double u = !camera.stereo ? x : right_eye ? 2 * x - 1 : 2 * x;
        Way way{};
        for (int c = 0; c < 3; ++c)
            way.v[c] = ((camera.top_left[c] + u * camera.rightwards[c]) + y * camera.downwards[c]) -
                       camera.origin[c];
        way.length = __builtin_sqrt(Beam::dot(way.v, way.v));
        return way;
    };
    const Way middle = way_to(0.5 * (across[0] + across[1]), 0.5 * (down[0] + down[1]));
    double magnitudes = 0;
    beam = {};
    for (int c = 0; c < 3; ++c) {
        const double aside =
            camera.stereo ? (right_eye ? -camera.to_left_eye[c] : camera.to_left_eye[c]) : 0;
        beam.dir[c] = middle.v[c] / middle.length;
        beam.start[c] = (camera.origin[c] + middle.v[c]) + aside;
        for (const double x : {camera.top_left[c], camera.rightwards[c], camera.downwards[c],
                               camera.origin[c], aside})
            magnitudes += __builtin_fabs(x);
    }
    // What rounding can do to a place; much more than it does.
    const double slack = 1e-14 * magnitudes;
    double radius = 0, cosine = 1, nearest = middle.length;
    for (const double x : across)
        for (const double y : down) {
            const Way corner = way_to(x, y);
            const double off[3] = {corner.v[0] - middle.v[0], corner.v[1] - middle.v[1],
                                   corner.v[2] - middle.v[2]};
            radius = std::max(radius, __builtin_sqrt(Beam::dot(off, off)));
            cosine = std::min(cosine, Beam::dot(corner.v, beam.dir) / corner.length);
            nearest = std::min(nearest, corner.length);
        }
    // Of a rectangle in a plane, a corner is farthest off any direction.
    nearest -= radius; // of all its points
    // Where squares of lengths are neither 0 nor infinite.
    if (!(cosine > 0.5) || !(nearest > 1e-140) || !(radius < 1e100) || !(magnitudes < 1e100))
        return false;
    const double spread = __builtin_sqrt(1 - cosine * cosine + 1e-14) / cosine + slack / nearest;
    // A start may lie behind the beam's, and its ray have spread when it gets there.
    beam.spread = spread;
    beam.radius = (radius + slack) * (1 + spread);
    beam.length = __builtin_inf();
    return true;
}

} // namespace
} // namespace fraja::kernel
