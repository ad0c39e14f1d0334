#include "tests/broker/farm.hpp"

using namespace fraja;
using namespace fraja::broker;
using namespace fraja::protocol;
using namespace std::chrono_literals;

namespace {

std::uint64_t jobs(const Farm& farm, JobPhase phase) {
    return farm.dispatcher.figures().jobs.at(static_cast<std::size_t>(phase));
}

} // namespace

TEST_CASE("each worker is counted in one state, and so is each job") {
    Farm farm;
    CHECK(farm.dispatcher.figures().workers() == 0);
    farm.worker_arrives("busy", 1, 1, 2);
    farm.worker_arrives("drains", 2, 4, 2);
    farm.beat("drains", 0, {});
    const JobId first = farm.submit(1, 4);
    farm.worker_arrives("idle", 3, 2, 2);
    Figures f = farm.dispatcher.figures();
    CHECK(f.workers_busy + f.workers_idle == 2);
    CHECK(f.workers_draining == 1);
    CHECK(f.workers() == 3);
    CHECK(f.threads == 3);
    CHECK(f.credit == 4);
    CHECK(f.tiles_in_flight == 4);
    CHECK(f.cells_left == 4);
    CHECK(jobs(farm, JobPhase::running) == 1);

    farm.now = farm.now + 5ms;
    for (const char* peer : {"busy", "idle"})
        for (const RenderTile& tile : farm.tiles(peer))
            farm.render(peer, tile);
    f = farm.dispatcher.figures();
    CHECK(farm.state(first).phase == JobPhase::done);
    CHECK(f.workers_idle == 2);
    CHECK(f.tiles_in_flight == 0);
    CHECK(f.cells_left == 0);
    CHECK(jobs(farm, JobPhase::done) == 1);
    CHECK(jobs(farm, JobPhase::running) == 0);
    CHECK(f.counters.tiles_sent == 4);
    CHECK(f.counters.tiles_done == 4);
    CHECK(f.counters.rays.camera == farm.state(first).rays.camera);
    CHECK(f.counters.render_time == farm.state(first).render_time);
    CHECK(f.counters.jobs_acknowledged == 1);
    CHECK(f.counters.jobs_done == 1);
    CHECK(f.counters.workers_welcomed == 3);
}

TEST_CASE("what is left is told in cells, and in a thread's time once one has drawn something") {
    Farm farm;
    farm.submit(1, 4);
    CHECK(farm.dispatcher.figures().cells_left == 4);
    CHECK(farm.dispatcher.figures().jobs_ready == 1);
    CHECK(farm.dispatcher.figures().work_left_s == 0);
    farm.worker_arrives("w", 1, 1, 1);
    const auto tiles = farm.tiles("w");
    REQUIRE(tiles.size() == 1);
    farm.now = farm.now + 5ms;
    farm.render("w", tiles[0]);
    // A tile took 5 ms, and three are left.
    CHECK(farm.dispatcher.figures().cells_left == 3);
    CHECK(farm.dispatcher.figures().work_left_s == doctest::Approx(0.015));
}

TEST_CASE("hellos that are refused are counted, and told as one kind of event") {
    Limits limits;
    limits.workers_max = 1;
    limits.clients_max = 1;
    Farm farm(limits);
    farm.worker_arrives("w", 1, 1, 1);
    farm.client_arrives("c");
    farm.logs.clear();
    for (std::uint8_t i = 2; i < 12; ++i) {
        farm.worker_arrives("w" + std::to_string(i), i, 1, 1);
        farm.client_arrives("c" + std::to_string(i));
    }
    CHECK(farm.dispatcher.counters().peers_refused == 20);
    CHECK(farm.logs.size() == 20);
    for (const Log& line : farm.logs) {
        CHECK(line.kind == "peer_refused");
        CHECK(line.subject.empty());
    }
}

TEST_CASE("while the store fails the figures say so") {
    Farm farm;
    farm.event(StoreFails{"disk full"});
    CHECK(farm.dispatcher.figures().store_trouble == "disk full");
    CHECK(farm.dispatcher.figures().store_is_behind);
    farm.event(StoreWorks{});
    CHECK_FALSE(farm.dispatcher.figures().store_is_behind);
}
