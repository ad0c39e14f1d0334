// Our election beside the bully algorithm: what each lets happen.
#include "tests/sim/elections.hpp"

#include <doctest/doctest.h>

namespace fraja::sim {
namespace {

using namespace std::chrono_literals;

ElectionReport report_of(ElectionRule rule, std::uint64_t seed, Duration time = 1h) {
    return run_election({.rule = rule, .seed = seed, .time = time});
}

TEST_CASE("no worker obeys a leader that was replaced; by the bully algorithm they do") {
    std::uint64_t replaced_by_bully = 0;
    for (std::uint64_t seed = 1; seed <= 3; ++seed) {
        CAPTURE(seed);
        const ElectionReport ours = report_of(ElectionRule::ours, seed);
        CHECK(ours.tiles > 100'000);
        CHECK(ours.replaced == 0);
        replaced_by_bully += report_of(ElectionRule::bully, seed).replaced;
    }
    CHECK(replaced_by_bully > 1'000);
}

TEST_CASE("without accidents each elects one leader, and it stays") {
    for (const ElectionRule rule : {ElectionRule::ours, ElectionRule::bully}) {
        const ElectionReport report = run_election({.rule = rule,
                                                    .time = 10min,
                                                    .crashes_every = {},
                                                    .partitions_every = {},
                                                    .hangs_every = {}});
        CHECK(report.elections == 1);
        CHECK(report.with_several == Duration::zero());
        CHECK(report.without < 5s);
    }
}

TEST_CASE("the broker that leads moves less where workers answer all and watchers are anybody's") {
    const ElectionReport ours = report_of(ElectionRule::ours, 1, 15min),
                         bully = report_of(ElectionRule::bully, 1, 15min);
    CHECK(ours.busiest < bully.busiest);
}

} // namespace
} // namespace fraja::sim
