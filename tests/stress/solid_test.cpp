// Quick here; long by hand, as tools/bench/accuracy.
#include "tests/stress/solid_cases.hpp"

#include <doctest/doctest.h>

namespace fraja::stress {
namespace {

TEST_CASE("what fills the space along a ray is what exact evaluation says") {
    for (const SolidRegime& regime : solid_regimes()) {
        CAPTURE(regime.name);
        Rng rng(1);
        const Walks walks = regime.run(rng, 2'000);
        CHECK(walks.rays >= 2'000);
        CHECK(walks.changes > walks.rays);
        CHECK(walks.grazing < walks.rays / 100);
        CHECK(walks.wrong == 0);
        CHECK(walks.entries > walks.rays / 4);
        CHECK(walks.wrong_entries == 0);
    }
}

} // namespace
} // namespace fraja::stress
