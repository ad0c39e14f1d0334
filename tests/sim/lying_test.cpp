// A worker that answers wrong pixels, in a farm where nothing else goes wrong.
#include "tests/sim/scenario.hpp"

#include <doctest/doctest.h>

namespace fraja::sim {
namespace {

using namespace std::chrono_literals;

/// Four workers, of whom the last lies about so many of its tiles, and a picture of 400 tiles.
Scenario with_liar(std::uint64_t seed, double lies, double verify) {
    Scenario s;
    s.seed = seed;
    s.store.there = true;
    for (int i = 0; i < 4; ++i)
        s.workers.push_back({.threads = 2, .tags = {}});
    s.workers.back().lies = lies;
    JobPlan job;
    job.settings.size = {160, 160};
    job.settings.crop = {0, 0, 160, 160};
    job.tile_side = 8;
    job.wishes.verify = verify;
    job.work = WorkMap({160, 160}, 8, std::vector<double>(400, 1e4));
    s.jobs.push_back(job);
    s.ends_at = 10min;
    return s;
}

Report report_of(const Scenario& scenario) {
    Report report = run(scenario);
    for (const std::string& violation : report.violations)
        FAIL_CHECK(violation);
    REQUIRE(report.jobs[0].done);
    return report;
}

TEST_CASE("where all tiles are checked, no wrong pixel is left, however seldom a worker lies") {
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
        CAPTURE(seed);
        const Report report = report_of(with_liar(seed, 0.02 * static_cast<double>(seed), 1));
        CHECK(report.jobs[0].wrong_cells == 0);
        CHECK(report.jobs[0].unchecked_tiles == 0);
    }
}

TEST_CASE("one that always lies is found by one tile in ten, and all that it drew is drawn again") {
    int late = 0;
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
        CAPTURE(seed);
        const Report report = report_of(with_liar(seed, 1, 0.1));
        CHECK(report.jobs[0].wrong_cells == 0);
        // It is found by the first of its tiles that is checked, which in one farm of 20 is not
        // among the first 30; there are some more on their way then.
        late += report.workers[3].tiles > 30 + 6;
    }
    CHECK(late <= 3);
}

TEST_CASE("where no tile is checked, wrong pixels are believed") {
    const Report report = report_of(with_liar(1, 1, 0));
    CHECK(report.jobs[0].wrong_cells > 50);
}

TEST_CASE("one tile in ten costs a tenth more") {
    const auto tiles = [](double verify) {
        std::uint64_t sum = 0;
        for (const WorkerReport& worker : report_of(with_liar(3, 0, verify)).workers)
            sum += worker.tiles;
        return sum;
    };
    CHECK(tiles(0) < 410); // a few at the end are given out twice
    CHECK(tiles(0.1) > 425);
    CHECK(tiles(0.1) < 465);
}

} // namespace
} // namespace fraja::sim
