// Jobs with a time limit: passes over the whole picture until the time is up.
#include "common/protocol/limits.hpp"
#include "common/protocol/passes.hpp"
#include "tests/broker/farm.hpp"

#include <doctest/doctest.h>
#include <set>

namespace fraja::broker {
namespace {

using namespace protocol;
using namespace std::chrono_literals;

SubmitJob limited(std::uint32_t columns, Duration time, std::uint32_t max_samples = 1024) {
    SubmitJob job = Farm::picture(1, columns);
    job.settings.time_limit = time;
    job.settings.max_samples = max_samples;
    return job;
}

/// Answers every tile at once that is handed out from now on, `count` at most.
std::vector<RenderTile> render_tiles(Farm& farm, std::size_t count) {
    std::vector<RenderTile> rendered;
    std::vector<RenderTile> open = farm.tiles("w");
    while (!open.empty() && rendered.size() < count) {
        rendered.push_back(open.front());
        open.erase(open.begin());
        farm.render("w", rendered.back());
        for (const RenderTile& more : farm.tiles("w"))
            open.push_back(more);
    }
    for (const RenderTile& tile : open) // still in flight
        farm.sent["w"].push_back(tile);
    return rendered;
}

TEST_CASE("a job with a time limit is drawn pass after pass") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 2);
    const JobId job = farm.submit("client", limited(3, 10s));
    CHECK(farm.state(job).cell_count == 3 * pass_count(limited(3, 10s).settings));
    const auto tiles = render_tiles(farm, 8);
    REQUIRE(tiles.size() == 8);
    for (std::uint32_t i = 0; i < tiles.size(); ++i) {
        CAPTURE(i);
        CHECK(tiles[i].tile == TileIndex(i));
        CHECK(tiles[i].pass == i / 3);
        CHECK(tiles[i].rect == PixelRect{10 * (i % 3), 0, 10, 10});
    }
    CHECK(farm.state(job).phase == JobPhase::running);
}

TEST_CASE("when its time is up it is done, and what is in flight is not waited for") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 2);
    const SubmitJob wanted = limited(3, 10s);
    farm.subscribe(wanted.job);
    const JobId job = farm.submit("client", wanted);
    REQUIRE(render_tiles(farm, 4).size() == 4);
    const auto in_flight = farm.tiles("w");
    for (std::uint64_t second = 1; second < 10; ++second) {
        farm.now = farm.now + 1s;
        farm.beat("w", 2, in_flight, second);
    }
    farm.now = farm.now + 1s - 1ms;
    farm.event(Tick{});
    CHECK(farm.state(job).phase == JobPhase::running);
    CHECK(farm.dispatcher.next_deadline() <= farm.now + 1ms);
    farm.now = farm.now + 1ms;
    farm.event(Tick{});
    const JobState state = farm.state(job);
    CHECK(state.phase == JobPhase::done);
    CHECK(state.done_count == 4);
    CHECK(state.elapsed == 10s);
    CHECK(farm.all<CancelTile>("w").size() == 2);
    CHECK(farm.published<JobState>(job_topic(job)).back().phase == JobPhase::done);
    // Late, and not wanted.
    CHECK(farm.published<TileDone>(job_topic(job)).size() == 4);
}

TEST_CASE("a picture is whole: the first pass is done, however long it takes, and no other begun") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 1);
    const JobId job = farm.submit("client", limited(3, 10s));
    const RenderTile first = farm.tiles("w").at(0);
    for (int i = 0; i < 11; ++i) {
        farm.now = farm.now + 1s;
        farm.beat("w", 1, {first}, 1 + static_cast<std::uint64_t>(i));
    }
    CHECK(farm.state(job).phase == JobPhase::running);
    CHECK(farm.state(job).reason == "late: its time is up, and its first pass is not done yet");
    farm.render("w", first);
    CHECK(render_tiles(farm, 100).size() == 2);
    CHECK(farm.state(job).phase == JobPhase::done);
    CHECK(farm.state(job).done_count == 3);
    CHECK(farm.tiles("w").empty());
}

TEST_CASE("a tile of a later pass that fails after that is not given out again") {
    Farm farm;
    farm.worker_arrives("v", 1, 1, 1);
    const JobId job = farm.submit("client", limited(2, 10s));
    const RenderTile slow = farm.tiles("v").at(0);
    farm.worker_arrives("w", 2, 1, 1);
    REQUIRE(render_tiles(farm, 1).size() == 1); // the other one of the first pass
    const RenderTile ahead = farm.tiles("w").at(0);
    CHECK(ahead.pass == 1);
    for (int i = 0; i < 11; ++i) {
        farm.now = farm.now + 1s;
        farm.beat("v", 1, {slow}, 1 + static_cast<std::uint64_t>(i));
        farm.beat("w", 1, {ahead}, 1 + static_cast<std::uint64_t>(i));
    }
    farm.fail("w", ahead, FailureCode::machine);
    CHECK(farm.tiles("w").empty());
    farm.render("v", slow);
    CHECK(farm.state(job).phase == JobPhase::done);
}

TEST_CASE("a job that has as many samples as it may is done before its time") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 2);
    const JobId job = farm.submit("client", limited(2, 10s, 12));
    CHECK(render_tiles(farm, 100).size() == 2 * 3); // 4, 8, 12 samples
    CHECK(farm.state(job).phase == JobPhase::done);
    farm.pass(11s); // nothing is left to end
    CHECK(farm.state(job).phase == JobPhase::done);
}

TEST_CASE("a job that was cancelled has no deadline any more") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 2);
    const JobId job = farm.submit("client", limited(2, 10s));
    farm.say("client", ControlJob{job, JobDeed::cancel, 0});
    farm.pass(11s);
    CHECK(farm.state(job).phase == JobPhase::cancelled);
}

TEST_CASE("passes count among a job's tiles") {
    Farm farm;
    SubmitJob many = limited(1, 10s, samples_max);
    many.settings.size = {4096, 4096};
    many.settings.crop = {0, 0, 4096, 4096};
    many.tile_side = 8; // 262,144 tiles, 28 passes
    farm.client_arrives("client");
    farm.say("client", many);
    CHECK(farm.last<Refused>("client").code == RefusalCode::invalid);
}

TEST_CASE("of the passes as many are drawn as there is room for in client_bytes_max") {
    // A pass of 3 tiles of 10 x 10 pixels takes 3 x (100 x 20 + 300) bytes.
    Farm farm(Limits{.client_bytes_max = 2 * 6'900 + 100});
    farm.worker_arrives("w", 1, 1, 2);
    const JobId job = farm.submit("client", limited(3, 10s));
    CHECK(render_tiles(farm, 100).size() == 6);
    CHECK(farm.state(job).phase == JobPhase::done);

    Farm small(Limits{.client_bytes_max = 6'899});
    small.client_arrives("client");
    small.say("client", limited(3, 10s));
    CHECK(small.last<Refused>("client").code == RefusalCode::limit_exceeded);
}

TEST_CASE("of the passes as many are drawn as there is room for in stored_bytes_max") {
    // A pass of 3 tiles of 10 x 10 pixels takes 3 x (100 x 20 + 300) bytes.
    Farm farm(Limits{.stored_bytes_max = 2 * 6'900 + 100});
    farm.worker_arrives("w", 1, 1, 2);
    const JobId job = farm.submit("client", limited(3, 10s));
    CHECK(render_tiles(farm, 100).size() == 6);
    const JobState state = farm.state(job);
    CHECK(state.phase == JobPhase::done);
    CHECK(state.done_count == 6);
    CHECK(state.cell_count == 3 * pass_count(limited(3, 10s).settings)); // where tiles lie
    // What is over makes room, and one that has been cut short takes up what it has.
    SubmitJob next = limited(3, 10s);
    next.job = id_of<JobId>(2);
    farm.submit("client", next);
    CHECK(render_tiles(farm, 100).size() == 6);

    Farm small(Limits{.stored_bytes_max = 6'899});
    small.client_arrives("client");
    small.say("client", limited(3, 10s));
    CHECK(small.last<Refused>("client").code == RefusalCode::limit_exceeded);
}

} // namespace
} // namespace fraja::broker
