// Several brokers that stand for each other: who deals out tiles, what each of them has, and what
// becomes of both when one of them dies, comes back, or is cut off.
#include "tests/broker/fleet.hpp"

#include "tests/support/seeds.hpp"

#include <chrono>
#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::broker;
using namespace fraja::protocol;
using namespace std::chrono_literals;

namespace {

bool has_logged(const Fleet& fleet, std::size_t i, std::string_view kind) {
    return std::ranges::any_of(fleet.nodes[i].logs,
                               [&](const Log& line) { return line.kind == kind; });
}

} // namespace

TEST_CASE("the broker that started first deals out the tiles, and it alone") {
    Fleet fleet(3);
    fleet.pass(4s);
    CHECK(fleet.leaders() == std::vector<std::size_t>{0});
    fleet.worker_arrives("w", 1, 2);
    const JobId job = fleet.submit(0, "c", Farm::picture(1, 6));
    fleet.pass(100ms);
    CHECK(fleet.heard<RenderTile>(0, "w").size() == 2);
    CHECK(fleet.heard<RenderTile>(1, "w").empty());
    CHECK(fleet.heard<RenderTile>(2, "w").empty());
    fleet.render_all("w");
    for (std::size_t i = 0; i < 3; ++i) {
        CAPTURE(i);
        REQUIRE(fleet.state(i, job).has_value());
        CHECK(fleet.state(i, job)->phase == JobPhase::done);
        CHECK(fleet.state(i, job)->done_count == 6);
    }
    CHECK(fleet.rendered == 6);
}

TEST_CASE("whichever broker is asked, the job is drawn, and its stream is whole everywhere") {
    Fleet fleet(3);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 2);
    const SubmitJob picture = Farm::picture(1, 6);
    for (std::size_t i = 0; i < 3; ++i)
        fleet.event(i, TopicSubscribed{job_topic(picture.job)});
    const JobId job = fleet.submit(2, "c", picture);
    CHECK(fleet.state(2, job)->phase != JobPhase::waiting_for_scene);
    fleet.render_all("w");
    for (std::size_t i = 0; i < 3; ++i) {
        CHECK(fleet.state(i, job)->phase == JobPhase::done);
        CHECK(fleet.state(i, job)->number == 1);
        CHECK(fleet.published(i, job) == 6);
    }
}

TEST_CASE("a job is acknowledged when all brokers that are here have it") {
    Fleet fleet(3);
    fleet.pass(4s);
    fleet.cut(0, 2);
    fleet.submit(0, "c", Farm::picture(1, 6));
    CHECK(fleet.state(0, id_of<JobId>(1))->phase == JobPhase::waiting_for_scene);
    CHECK(fleet.state(1, id_of<JobId>(1))->phase == JobPhase::queued);
    fleet.pass(2s); // by then the third one is known to be gone
    CHECK(fleet.state(0, id_of<JobId>(1))->phase == JobPhase::queued);
    CHECK(has_logged(fleet, 0, "broker_gone"));
}

TEST_CASE("the next broker takes over, and what workers have in hand is not drawn twice") {
    for (std::size_t count = 2; count <= 5; ++count) {
        CAPTURE(count);
        Fleet fleet(count);
        fleet.pass(4s);
        fleet.worker_arrives("w", 1, 3);
        fleet.worker_arrives("v", 2, 3);
        const JobId job = fleet.submit(0, "c", Farm::picture(1, 40));
        for (std::size_t dead = 0; dead + 1 < count; ++dead) {
            for (int i = 0; i < 4; ++i)
                REQUIRE(fleet.render_one(i % 2 == 0 ? "w" : "v"));
            fleet.kill(dead);
            fleet.render_one("w"); // its answer comes while nobody leads
            fleet.pass(2s);
            CHECK(fleet.leaders() == std::vector{dead + 1});
        }
        for (int i = 0; i < 100; ++i) {
            fleet.render_one("w");
            fleet.render_one("v");
        }
        CHECK(fleet.state(count - 1, job)->phase == JobPhase::done);
        CHECK(fleet.rendered == 40);
    }
}

TEST_CASE("a broker that comes back has all that the others have, and does not take the lead") {
    Fleet fleet(2);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 2);
    const JobId first = fleet.submit(0, "c", Farm::picture(1, 6));
    fleet.render_all("w");
    fleet.kill(0);
    fleet.pass(2s);
    const JobId second = fleet.submit(1, "c", Farm::picture(2, 6));
    REQUIRE(fleet.render_one("w"));
    fleet.start(0);
    fleet.greet(0, "w");
    fleet.pass(4s);
    CHECK(fleet.leaders() == std::vector<std::size_t>{1});
    CHECK(fleet.at(0).membership().is_synced());
    CHECK(fleet.state(0, first)->done_count == 6);
    CHECK(fleet.state(0, first)->phase == JobPhase::done);
    CHECK(fleet.state(0, second)->done_count == 1);
    fleet.kill(1);
    fleet.pass(2s);
    CHECK(fleet.leaders() == std::vector<std::size_t>{0});
    fleet.render_all("w");
    CHECK(fleet.state(0, second)->phase == JobPhase::done);
    CHECK(fleet.rendered == 12);
}

TEST_CASE("what is wanted of a job holds at all brokers, whichever was told") {
    Fleet fleet(2);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 1);
    const JobId job = fleet.submit(0, "c", Farm::picture(1, 6));
    fleet.say(1, "c", ControlJob{job, JobDeed::pause, 0});
    CHECK(fleet.state(0, job)->phase == JobPhase::paused);
    fleet.render_all("w");
    CHECK(fleet.state(0, job)->done_count == 1);
    fleet.say(0, "c", ControlJob{job, JobDeed::set_priority, 7});
    fleet.say(1, "c", ControlJob{job, JobDeed::resume, 0});
    CHECK(fleet.state(1, job)->priority == 7);
    CHECK(fleet.render_one("w"));
    fleet.say(1, "c", ControlJob{job, JobDeed::cancel, 0});
    CHECK(fleet.state(0, job)->phase == JobPhase::cancelled);
    fleet.render_all("w");
    fleet.say(1, "c", ControlJob{job, JobDeed::retry, 0});
    fleet.pass(100ms);
    fleet.render_all("w");
    CHECK(fleet.state(0, job)->phase == JobPhase::done);
    CHECK(fleet.state(1, job)->phase == JobPhase::done);
}

TEST_CASE("a worker that is drained at one broker gets nothing of the one that leads") {
    Fleet fleet(2);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 1);
    fleet.say(1, "c", ClientHello{"c", "test"});
    fleet.say(1, "c", ControlWorker{"w", WorkerDeed::drain});
    const JobId job = fleet.submit(0, "d", Farm::picture(1, 3));
    fleet.pass(100ms);
    CHECK_FALSE(fleet.render_one("w"));
    fleet.say(1, "c", ControlWorker{"w", WorkerDeed::undrain});
    fleet.render_all("w");
    CHECK(fleet.state(0, job)->phase == JobPhase::done);
}

TEST_CASE("a job that waits for its scene at one broker is taken from one that has it") {
    Fleet fleet(2);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 2);
    const SubmitJob picture = Farm::picture(1, 3);
    fleet.say(1, "c", ClientHello{"c", "test"});
    fleet.say(1, "c", picture); // the scene never comes there
    CHECK(fleet.heard<NeedChunk>(1, "c").size() == 1);
    (void)fleet.submit(0, "c", picture);
    CHECK(fleet.state(1, picture.job)->phase != JobPhase::waiting_for_scene);
    fleet.pass(fleet.limits.scene_patience + 2s);
    CHECK_FALSE(is_over(fleet.state(0, picture.job)->phase));
    fleet.render_all("w");
    CHECK(fleet.state(1, picture.job)->phase == JobPhase::done);
}

TEST_CASE("a job that is over is tried again where it was copied without its scene") {
    Fleet fleet(2);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 2);
    const JobId job = fleet.submit(0, "c", Farm::picture(1, 3));
    fleet.say(0, "c", ControlJob{job, JobDeed::cancel, 0});
    fleet.kill(1);
    fleet.start(1);
    fleet.greet(1, "w");
    fleet.pass(4s);
    REQUIRE(fleet.state(1, job)->phase == JobPhase::cancelled);
    fleet.say(1, "d", ClientHello{"d", "test"});
    fleet.say(1, "d", ControlJob{job, JobDeed::retry, 0});
    fleet.pass(100ms);
    REQUIRE_FALSE(fleet.heard<JobState>(1, "d").empty());
    CHECK_FALSE(is_over(fleet.heard<JobState>(1, "d").back().phase));
    fleet.kill(0); // the scene has come, too
    fleet.pass(2s);
    fleet.render_all("w");
    CHECK(fleet.state(1, job)->phase == JobPhase::done);
}

TEST_CASE("tiles that only a broker had that is gone are not waited for for ever") {
    Limits limits;
    limits.copy_lag = 1h; // its tiles are still on their way when it dies
    Fleet fleet(2, limits);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 2);
    const SubmitJob picture = Farm::picture(1, 3);
    (void)fleet.submit(0, "c", picture);
    fleet.render_all("w");
    REQUIRE(fleet.state(0, picture.job)->phase == JobPhase::done);
    fleet.kill(1);
    fleet.start(1);
    fleet.greet(1, "w");
    while (!fleet.state(1, picture.job))
        fleet.pass(25ms);
    fleet.kill(0);
    fleet.pass(2s);
    REQUIRE(fleet.state(1, picture.job)->phase == JobPhase::paused);
    fleet.say(1, "c", ControlJob{picture.job, JobDeed::resume, 0});
    CHECK(fleet.state(1, picture.job)->phase == JobPhase::paused); // it has no scene
    fleet.pass(fleet.limits.tiles_patience + 2s);
    CHECK_FALSE(fleet.state(1, picture.job));
    (void)fleet.submit(1, "e", picture); // its client, which hears that
    fleet.pass(3s);
    fleet.render_all("w");
    CHECK(fleet.state(1, picture.job)->phase == JobPhase::done);
}

TEST_CASE("of a checked job a standby broker has what the one that leads has, and no more") {
    Fleet fleet(2);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 2);
    fleet.worker_arrives("v", 2, 2);
    SubmitJob picture = Farm::picture(1, 4);
    picture.wishes.verify = 1;
    (void)fleet.submit(0, "c", picture);
    fleet.pass(100ms);
    REQUIRE(fleet.render_one("w"));
    CHECK(fleet.state(0, picture.job)->done_count == 1);
    CHECK(fleet.state(1, picture.job)->done_count == 0);
    fleet.pass(3s);
    CHECK(fleet.state(1, picture.job)->done_count == 1);
    fleet.kill(0);
    fleet.pass(2s);
    for (int i = 0; i < 20; ++i) {
        fleet.render_one("w");
        fleet.render_one("v");
    }
    CHECK(fleet.state(1, picture.job)->phase == JobPhase::done);
    CHECK(fleet.state(1, picture.job)->checks.agreed == 4);
}

TEST_CASE("two that do not hear each other both lead; when they do, one does, and has it all") {
    Fleet fleet(2);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 2);
    fleet.cut(0, 1);
    fleet.pass(3s);
    const JobId here = fleet.submit(0, "c", Farm::picture(1, 4));
    const JobId there = fleet.submit(1, "d", Farm::picture(2, 4));
    CHECK(fleet.state(0, here)->number == 1);
    CHECK(fleet.state(1, there)->number == 1);
    fleet.pass(5s);
    fleet.heal();
    fleet.pass(5s);
    CHECK(fleet.leaders() == std::vector<std::size_t>{0});
    for (int i = 0; i < 20; ++i) {
        fleet.render_one("w");
        fleet.pass(100ms);
    }
    fleet.pass(3s);
    for (std::size_t i = 0; i < 2; ++i) {
        CHECK(fleet.state(i, here)->phase == JobPhase::done);
        CHECK(fleet.state(i, there)->phase == JobPhase::done);
    }
    // Nobody's number means two jobs.
    CHECK(fleet.state(0, here)->number == fleet.state(1, here)->number);
    CHECK(fleet.state(0, there)->number == fleet.state(1, there)->number);
    CHECK(fleet.state(0, here)->number != fleet.state(0, there)->number);
}

TEST_CASE("what one broker forgets all forget") {
    Limits limits;
    limits.finished_jobs_max = 1;
    Fleet fleet(2, limits);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 1);
    const JobId old = fleet.submit(0, "c", Farm::picture(1, 2));
    fleet.render_all("w");
    const JobId young = fleet.submit(1, "c", Farm::picture(2, 2));
    fleet.render_all("w");
    fleet.pass(2s);
    for (std::size_t i = 0; i < 2; ++i) {
        CHECK_FALSE(fleet.state(i, old).has_value());
        CHECK(fleet.state(i, young)->phase == JobPhase::done);
    }
}

TEST_CASE("whoever is told of one broker is told of all") {
    Fleet fleet(3);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 1);
    CHECK(fleet.heard<Welcome>(0, "w").back().brokers.size() == 3);
    fleet.start(3);
    fleet.pass(2s);
    CHECK(fleet.heard<Brokers>(0, "w").back().brokers.size() == 4);
    CHECK(fleet.leaders() == std::vector<std::size_t>{0});
}

TEST_CASE("brokers die and come back in any order: every job ends, and nothing is drawn wrongly") {
    for_each_seed(40, [](Rng& rng) {
        const std::size_t count = 2 + rng.below(4);
        Fleet fleet(count);
        fleet.pass(4s);
        fleet.worker_arrives("w", 1, 2);
        fleet.worker_arrives("v", 2, 3);
        std::vector<JobId> jobs;
        std::size_t alive = count;
        for (int turn = 0; turn < 60; ++turn) {
            const std::size_t i = rng.below(count);
            const bool is_alive = fleet.nodes[i].dispatcher != nullptr;
            switch (rng.below(8)) {
            case 0:
                if (is_alive && alive > 1 && fleet.at(i).membership().is_synced()) {
                    // Whoever is left must have it all, and tell so.
                    std::size_t synced = 0;
                    for (const auto& node : fleet.nodes)
                        synced += node.dispatcher && node.dispatcher->membership().is_synced();
                    if (synced > 1) {
                        fleet.kill(i);
                        --alive;
                    }
                }
                break;
            case 1:
                if (!is_alive) {
                    fleet.start(i);
                    fleet.greet(i, "w");
                    fleet.greet(i, "v");
                    ++alive;
                }
                break;
            case 2:
                if (is_alive && jobs.size() < 5 && fleet.at(i).membership().is_synced()) {
                    const auto id = static_cast<std::uint8_t>(1 + jobs.size());
                    jobs.push_back(fleet.submit(
                        i, "c" + std::to_string(turn),
                        rng.below(2) == 0
                            ? automatic(id, 100, 60)
                            : Farm::picture(id, 1 + static_cast<std::uint32_t>(rng.below(20)))));
                    fleet.pass(rng.below(2) == 0 ? 0s : 3s);
                }
                break;
            case 3:
                fleet.pass(std::chrono::milliseconds(rng.below(3000)));
                break;
            default:
                fleet.render_one(rng.below(2) == 0 ? "w" : "v");
            }
        }
        fleet.pass(5s);
        CHECK(fleet.leaders().size() == 1);
        for (int i = 0; i < 2'000; ++i) {
            const bool any = fleet.render_one("w") | fleet.render_one("v");
            if (!any)
                fleet.pass(200ms);
            if (i % 50 == 0)
                fleet.pass(500ms);
        }
        fleet.pass(5s);
        for (const JobId& job : jobs)
            for (std::size_t i = 0; i < count; ++i)
                if (fleet.nodes[i].dispatcher) {
                    const auto state = fleet.state(i, job);
                    REQUIRE(state.has_value());
                    CHECK(state->phase == JobPhase::done);
                    CHECK(state->done_count == state->cell_count);
                }
    });
}
