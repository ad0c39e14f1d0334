// Hits of the fast kernel against the truth, regime by regime.
//
// The kernel's own functions are called, in the narrowest instruction set; that the others give the
// same bits is tested elsewhere (tests/common/render/kernel/same_bits_test.cpp).
#pragma once

#include "common/base/rng.hpp"
#include "common/geometry/forms.hpp"
#include "common/math/vec.hpp"

#include <cstdint>
#include <string>
#include <vector>

namespace fraja::stress {

/// The greatest errors of a regime's cases.
struct Errors {
    std::uint64_t cases = 0;
    std::uint64_t missed = 0; ///< hits that the quick search did not find, or found where none is
    double t = 0;             ///< relative, in eps
    double place = 0;         ///< distance from the surface / scale, in eps
    double normal = 0;        ///< length of the difference, in eps
};

/// What may at most be; 0: not asked for.
struct Marks {
    double t = 0, place = 0, normal = 0;
};

struct Regime {
    std::string name;
    Marks marks;
    Errors (*run)(Rng& rng, std::uint64_t cases);
};

[[nodiscard]] const std::vector<Regime>& surface_regimes();

/// Rays that start outside, a fourth each at spheres, planes, cylinders and cones, half of those
/// past the tip; a few start on the surface. Counts those for which the shorter way to compute an
/// entry differs from the general one in any bit.
[[nodiscard]] std::uint64_t entries_that_differ(Rng& rng, std::uint64_t rays);

/// Rays in a mirror ball, grazing its wall by 1e-6 to 1.5 rad, 500 bounces each; a fifteenth of
/// them for each of 15 pairs of size and distance from the origin. Counts those that get off the
/// wall.
[[nodiscard]] std::uint64_t rays_that_leave_a_mirror_ball(Rng& rng, std::uint64_t rays);

} // namespace fraja::stress
