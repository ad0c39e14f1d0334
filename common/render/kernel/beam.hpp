// A beam: what some rays that go nearly the same way can touch, and what they cannot.
#pragma once

#include "common/render/kernel/tables.hpp"

#include <cstdint>

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

} // namespace
} // namespace fraja::kernel
