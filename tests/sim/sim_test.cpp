// Farms in pretend time: whatever goes wrong, every job ends with its pixels.
#include "tests/sim/scenario.hpp"
#include "tests/support/seeds.hpp"

#include <doctest/doctest.h>

namespace fraja::sim {
namespace {

TEST_CASE("the same seed gives the same history") {
    const Report one = run(random_scenario(5)), two = run(random_scenario(5));
    CHECK(one.history == two.history);
    CHECK(one.events == two.events);
    CHECK(one.duplicates == two.duplicates);
    CHECK(one.history != run(random_scenario(6)).history);
}

TEST_CASE("whatever goes wrong, every job ends with all its pixels, and right") {
    for (std::uint64_t seed = 1; seed <= 100 / seeds_per_trial; ++seed) {
        CAPTURE(seed);
        const Report report = run(random_scenario(seed));
        for (const std::string& violation : report.violations)
            FAIL_CHECK(violation);
    }
}

} // namespace
} // namespace fraja::sim
