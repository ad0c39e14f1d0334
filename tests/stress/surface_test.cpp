// Quick here; long by hand, as tools/bench/accuracy.
#include "tests/stress/surface_cases.hpp"

#include <doctest/doctest.h>

namespace fraja::stress {
namespace {

TEST_CASE("hits have the digits that are promised, regime by regime") {
    for (const Regime& regime : surface_regimes()) {
        CAPTURE(regime.name);
        Rng rng(1);
        const Errors e = regime.run(rng, 2'000);
        CHECK(e.cases == 2'000);
        CHECK(e.missed == 0);
        if (regime.marks.t > 0)
            CHECK(e.t <= regime.marks.t);
        if (regime.marks.place > 0)
            CHECK(e.place <= regime.marks.place);
        if (regime.marks.normal > 0)
            CHECK(e.normal <= regime.marks.normal);
    }
}

TEST_CASE("an entry is the same number, computed for a ray that is outside or for any") {
    Rng rng(1);
    CHECK(entries_that_differ(rng, 20'000) == 0);
}

TEST_CASE("no ray leaves a mirror ball") {
    Rng rng(1);
    CHECK(rays_that_leave_a_mirror_ball(rng, 300) == 0);
}

} // namespace
} // namespace fraja::stress
