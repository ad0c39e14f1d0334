// Farms in pretend time: whatever goes wrong, every job ends with its pixels.
#include "tests/sim/scenario.hpp"
#include "tests/support/seeds.hpp"

#include <chrono>
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

/// 16 workers and a picture.
Scenario quiet_farm() {
    Scenario s;
    s.seed = 3;
    s.workers.resize(16, WorkerPlan{.threads = 1, .rays_per_s = 2e3, .tags = {}});
    JobPlan job;
    job.at = std::chrono::seconds(2);
    job.settings.size = {96, 96};
    job.settings.crop = {0, 0, 96, 96};
    job.work = WorkMap(job.settings.size, 96, {96 * 96 * 10.0});
    s.jobs.push_back(job);
    return s;
}

TEST_CASE("a tree of three levels draws the picture, and its root hears of few tiles") {
    Scenario s = quiet_farm();
    const Report flat = run(s);
    // Two below the root, each with two more, which have four workers each.
    s.pipes = {{.delay = std::chrono::milliseconds(40), .bytes_per_s = 1e6}};
    s.branches = {{},          {.above = 0, .pipe = 1}, {.above = 1}, {.above = 1}, {.above = 2},
                  {.above = 2}};
    for (std::size_t i = 0; i < s.workers.size(); ++i)
        s.workers[i].branch = 3 + i % 4;
    const Report tree = run(s);
    for (const Report* report : {&flat, &tree}) {
        for (const std::string& violation : report->violations)
            FAIL_CHECK(violation);
        CHECK(report->jobs[0].done);
        CHECK(report->jobs[0].wrong_cells == 0);
    }
    REQUIRE(flat.traffic.size() == 1);
    REQUIRE(tree.traffic.size() == 7);
    const auto drawn = [](const Report& report) {
        std::uint64_t tiles = 0;
        for (const WorkerReport& worker : report.workers) {
            CHECK(worker.tiles > 0);
            tiles += worker.tiles;
        }
        return tiles;
    };
    CHECK(flat.traffic[0].answers == drawn(flat));
    CHECK(flat.traffic[0].connections == 16); // the client has left
    std::uint64_t heard = 0;
    for (std::size_t i = 3; i < 7; ++i)
        heard += tree.traffic[i].answers;
    CHECK(heard == drawn(tree));
    CHECK(tree.traffic[0].answers < drawn(tree));
    CHECK(tree.traffic[0].pixel_bytes >= 96 * 96 * 12);
    CHECK(tree.traffic[0].connections == 2);
    CHECK(tree.traffic[1].connections == 2);
    CHECK(tree.traffic[0].beats < flat.traffic[0].beats);
}

} // namespace
} // namespace fraja::sim
