// Several brokers that stand for each other: what each of them has, and what becomes of it when
// one of them dies, comes back, or is cut off.
#include "tests/broker/fleet.hpp"

#include "tests/support/allocated.hpp"
#include "tests/support/seeds.hpp"

#include <chrono>
#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::broker;
using namespace fraja::protocol;
using namespace std::chrono_literals;

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
    CHECK(fleet.has_logged(0, "broker_gone"));
}

TEST_CASE("a job's state says at how many of the other brokers it is") {
    Fleet fleet(3);
    fleet.pass(4s);
    const auto copies = [&](std::size_t i, const JobId& job) {
        const auto state = fleet.state(i, job);
        REQUIRE(state.has_value());
        return std::pair(state->copies, state->copies_wanted);
    };
    using Copies = std::pair<std::uint32_t, std::uint32_t>;
    const JobId first = fleet.submit(0, "c", Farm::picture(1, 6));
    fleet.pass(2s);
    for (std::size_t i = 0; i < 3; ++i)
        CHECK(copies(i, first) == Copies{2, 2});
    fleet.kill(1);
    fleet.pass(2s);
    CHECK(copies(0, first) == Copies{1, 2});
    CHECK(copies(2, first) == Copies{1, 2});
    fleet.kill(2);
    fleet.pass(2s);
    CHECK(copies(0, first) == Copies{0, 2});
    const JobId second = fleet.submit(0, "c", Farm::picture(2, 6));
    CHECK(copies(0, second) == Copies{0, 2});
    fleet.start(1); // another one, at the place of that which is gone
    fleet.pass(4s);
    for (const JobId& job : {first, second}) {
        CHECK(copies(0, job) == Copies{1, 2});
        CHECK(copies(1, job) == Copies{1, 2});
    }
}

TEST_CASE("the log names each job that no other broker of those that should has a copy of") {
    const auto kept_alone = [](const Fleet& fleet) {
        std::vector<std::string> lines;
        for (const Log& line : fleet.nodes[0].logs)
            if (line.kind == "kept_alone")
                lines.push_back(line.text);
        return lines;
    };
    Fleet fleet(2);
    fleet.pass(4s);
    (void)fleet.submit(0, "c", Farm::picture(1, 3));
    fleet.pass(1s);
    CHECK(kept_alone(fleet).empty());
    fleet.cut(0, 1); // it is here still, as far as is known
    fleet.kill(1);
    (void)fleet.submit(0, "c", Farm::picture(2, 3));
    fleet.pass(fleet.limits.copy_patience + 1s);
    (void)fleet.submit(0, "c", Farm::picture(3, 3));
    const auto lines = kept_alone(fleet);
    REQUIRE(lines.size() == 2);
    for (const std::string& line : lines)
        CHECK(line.ends_with("is kept by this broker alone: no other one is here"));

    Fleet waiting(2); // for one that never came
    waiting.kill(0);
    waiting.kill(1);
    waiting.start(0);
    waiting.pass(9s);
    (void)waiting.submit(0, "c", Farm::picture(1, 3));
    CHECK(kept_alone(waiting).size() == 1);

    Fleet alone(1);
    alone.pass(4s);
    (void)alone.submit(0, "c", Farm::picture(1, 3));
    CHECK(kept_alone(alone).empty());
}

TEST_CASE("a watcher hears that a job has lost a copy, and that it has one again") {
    Fleet fleet(2);
    fleet.pass(4s);
    const SubmitJob picture = Farm::picture(1, 6);
    fleet.event(0, TopicSubscribed{job_topic(picture.job)});
    fleet.submit(0, "c", picture);
    const auto last_told = [&] {
        const auto& stream = fleet.nodes[0].stream;
        for (auto p = stream.rbegin(); p != stream.rend(); ++p)
            if (const auto* state = std::get_if<JobState>(&p->message))
                return state->copies;
        return 99u;
    };
    fleet.pass(1s);
    CHECK(last_told() == 1);
    fleet.kill(1);
    fleet.pass(2s);
    CHECK(last_told() == 0);
    fleet.start(1);
    fleet.pass(4s);
    CHECK(last_told() == 1);
}

TEST_CASE("a broker that is gone for long is forgotten by all, though not at the same moment") {
    Fleet fleet(3);
    fleet.pass(4s);
    fleet.cut(0, 2); // the first one forgets it sooner
    fleet.pass(500ms);
    fleet.kill(2);
    fleet.pass(1s);
    const JobId job = fleet.submit(0, "c", Farm::picture(1, 3));
    fleet.pass(3s);
    for (std::size_t i = 0; i < 2; ++i)
        CHECK(fleet.state(i, job)->copies_wanted == 2);
    fleet.pass(fleet.limits.absence_max + 10s);
    for (std::size_t i = 0; i < 2; ++i) {
        CHECK(fleet.state(i, job)->copies_wanted == 1);
        CHECK(fleet.nodes[i].dialled.size() == 1);
    }
}

TEST_CASE("a lone broker wants no copies") {
    Fleet fleet(1);
    fleet.pass(4s);
    const JobId job = fleet.submit(0, "c", Farm::picture(1, 6));
    CHECK(fleet.state(0, job)->copies_wanted == 0);
    CHECK(fleet.at(0).figures().brokers_here == 1);
}

TEST_CASE("whoever asks a broker that stands by is told what is drawn, and by whom") {
    Fleet fleet(2);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 2);
    fleet.worker_arrives("v", 2, 2);
    const SubmitJob picture = Farm::picture(1, 9);
    (void)fleet.submit(1, "c", picture);
    fleet.pass(100ms);
    for (std::size_t i = 0; i < 2; ++i)
        fleet.event(i, TopicSubscribed{std::string(farm_topic)});
    const auto workers = [&](std::size_t i) {
        std::map<std::string, WorkerState> states;
        for (const Publish& told : fleet.nodes[i].stream)
            if (const auto* farm = std::get_if<FarmState>(&told.message))
                for (const WorkerState& state : farm->workers)
                    states[state.worker_name] = state;
        return states;
    };
    REQUIRE(fleet.render_one("w"));
    fleet.pass(2s);
    for (std::size_t i = 0; i < 2; ++i) {
        CAPTURE(i);
        const JobState state = *fleet.state(i, picture.job);
        CHECK(state.phase == JobPhase::running);
        CHECK(state.in_flight_count == 4);
        CHECK(state.worker_count == 2);
        CHECK(state.done_count == 1);
        CHECK(state.share_per_s > 0);
        CHECK(fleet.at(i).figures().tiles_in_flight == 4);
        CHECK(fleet.at(i).figures().workers_busy == 2);
        const auto told = workers(i);
        CHECK(told.at("w").in_flight_count == 2);
        CHECK(told.at("w").tiles_done == 1);
        CHECK(told.at("v").tiles_done == 0);
        CHECK(told.at("w").rays.total() > 0);
    }
    fleet.kill(0);
    fleet.pass(2s);
    CHECK(fleet.state(1, picture.job)->in_flight_count == 4); // each once
    fleet.render_all("w");
    fleet.render_all("v");
    fleet.pass(1s);
    CHECK(fleet.state(1, picture.job)->phase == JobPhase::done);
    CHECK(fleet.state(1, picture.job)->in_flight_count == 0);
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

TEST_CASE("what was cancelled before anybody was told that it is kept can be tried again") {
    Fleet fleet(2);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 2);
    fleet.cut(0, 1); // which nobody knows yet
    const JobId job = fleet.submit(0, "c", Farm::picture(1, 3));
    CHECK(fleet.state(0, job)->phase == JobPhase::waiting_for_scene);
    fleet.say(0, "c", ControlJob{job, JobDeed::cancel, 0});
    REQUIRE(fleet.state(0, job)->phase == JobPhase::cancelled);
    fleet.pass(5s);
    fleet.say(0, "c", ControlJob{job, JobDeed::retry, 0});
    fleet.pass(1s);
    fleet.render_all("w");
    CHECK(fleet.state(0, job)->phase == JobPhase::done);
}

TEST_CASE("what is tried again has its scene in the store, too, wherever that comes from") {
    Fleet fleet(2, {}, true);
    fleet.pass(4s);
    const SubmitJob picture = Farm::picture(1, 3);
    fleet.say(1, "broker 0", word_of(picture, {1, fleet.nodes[0].id}, JobPhase::cancelled));
    fleet.pass(100ms);
    REQUIRE(fleet.state(1, picture.job)->phase == JobPhase::cancelled);
    fleet.say(1, "broker 0", word_of(picture, {2, fleet.nodes[0].id}, JobPhase::queued));
    const auto keeps_scene = [&](const Write& write) {
        const auto* blob = std::get_if<PutBlob>(&write);
        return blob && blob->hash == picture.scene;
    };
    REQUIRE(std::ranges::none_of(fleet.nodes[1].kept, keeps_scene));
    fleet.say(1, "broker 0", Farm::scene_chunk());
    CHECK(std::ranges::any_of(fleet.nodes[1].kept, keeps_scene));
    CHECK_FALSE(is_over(fleet.state(1, picture.job)->phase));
}

TEST_CASE("a copy that is killed before its end is in the store does not go on when it is back") {
    for (const JobPhase phase : {JobPhase::cancelled, JobPhase::failed, JobPhase::done}) {
        CAPTURE(phase);
        Fleet fleet(2, {}, true);
        fleet.pass(4s);
        JobRecord word = word_of(Farm::picture(1, 3), {1, fleet.nodes[0].id}, phase);
        word.done_count = 3;
        fleet.say(1, "broker 0", word);
        const auto& kept = fleet.nodes[1].kept;
        const auto put = std::ranges::find_if(
            kept, [](const Write& write) { return std::holds_alternative<PutJob>(write); });
        REQUIRE(put != kept.end());
        CHECK(std::get<PutJob>(*put).phase == (phase == JobPhase::done ? JobPhase::paused : phase));
    }
}

TEST_CASE("a scene that only a broker had that is gone is not waited for for ever") {
    Fleet fleet(2);
    fleet.pass(4s);
    const SubmitJob picture = Farm::picture(1, 3);
    fleet.say(1, "broker 0", word_of(picture, {1, fleet.nodes[0].id}, JobPhase::queued));
    fleet.kill(0);
    fleet.pass(fleet.limits.partial_copy_patience - 2s);
    CHECK(fleet.state(1, picture.job)->phase == JobPhase::waiting_for_scene);
    fleet.pass(4s);
    CHECK_FALSE(fleet.state(1, picture.job).has_value());
    (void)fleet.submit(1, "c", picture); // as its client does, that hears that
    fleet.pass(3s);
    CHECK(fleet.state(1, picture.job)->phase == JobPhase::queued);
}

TEST_CASE("what an answer brought nothing of is not asked for again at once") {
    Fleet fleet(2);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 1);
    const SubmitJob picture = Farm::picture(1, 3);
    (void)fleet.submit(0, "c", picture);
    fleet.pass(1s);
    const RenderTile given = fleet.workers.at("w").has.front();
    fleet.cut(0, 1);
    const JobState state = *fleet.state(1, picture.job);
    const std::size_t before = fleet.nodes[1].repairs;
    const auto asked = [&] { return fleet.nodes[1].repairs - before; };
    fleet.say(1, "broker 0", JobDigests{{{picture.job, state.revision, 1}}, state.epoch});
    REQUIRE(asked() == 1);
    const auto say_that_more_is_left = [&] { fleet.say(1, "broker 0", RepairDone{state, 2}); };
    SUBCASE("as it was told twice, or can take none of it") {
        for (int i = 0; i < 9; ++i)
            say_that_more_is_left();
        CHECK(asked() == 1);
    }
    SUBCASE("but when it brought some") {
        fleet.say(1, "broker 0",
                  TileDone{.job = picture.job,
                           .tile = given.tile,
                           .rect = given.rect,
                           .worker_name = "w",
                           .rays = {},
                           .worker = id_of<WorkerId>(1),
                           .blobs = Farm::answer(given).blobs});
        say_that_more_is_left();
        CHECK(asked() == 2);
    }
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
    fleet.pass(fleet.limits.partial_copy_patience + 2s);
    CHECK_FALSE(fleet.state(1, picture.job));
    (void)fleet.submit(1, "e", picture); // its client, which hears that
    fleet.pass(3s);
    fleet.render_all("w");
    CHECK(fleet.state(1, picture.job)->phase == JobPhase::done);
}

TEST_CASE("a tile says in which term it was sent, not in which it was drawn") {
    Fleet fleet(2);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 2);
    const SubmitJob picture = Farm::picture(1, 4);
    for (std::size_t i = 0; i < 2; ++i)
        fleet.event(i, TopicSubscribed{job_topic(picture.job)});
    (void)fleet.submit(0, "c", picture);
    fleet.pass(100ms);
    REQUIRE(fleet.render_one("w"));
    const auto epoch = [&](std::size_t i) { return fleet.at(i).membership().term().counter; };
    const auto first = epoch(0);
    for (const Publish& told : fleet.nodes[0].stream)
        if (const auto* tile = std::get_if<TileDone>(&told.message))
            CHECK(tile->epoch == first);
    CHECK(fleet.published(0, picture.job) == 1);
    fleet.kill(0);
    fleet.pass(2s);
    REQUIRE(epoch(1) > first);
    fleet.say(1, "c", Repair{picture.job, 9, Bytes(1)});
    const auto repaired = fleet.heard<TileDone>(1, "c");
    REQUIRE(repaired.size() == 1);
    CHECK(repaired[0].epoch == epoch(1));
}

TEST_CASE("the scene of what is tried again comes from another broker when who said so is gone") {
    Fleet fleet(2);
    fleet.pass(4s);
    fleet.cut(0, 1);
    const SubmitJob picture = Farm::picture(1, 4);
    (void)fleet.submit(0, "c", picture);
    fleet.pass(9s);
    JobRecord word = word_of(picture, {1, fleet.nodes[0].id}, JobPhase::cancelled);
    fleet.say(1, "broker 0", word);
    REQUIRE(fleet.state(1, picture.job)->phase == JobPhase::cancelled);
    word.revision = {2, id_of<BrokerId>(99)};
    word.phase = JobPhase::queued;
    fleet.say(1, "broker 0", word);
    CHECK(fleet.state(1, picture.job)->phase == JobPhase::cancelled); // without a scene
    fleet.heal();
    fleet.pass(9s);
    CHECK(fleet.state(1, picture.job)->phase == JobPhase::queued);
}

TEST_CASE("a job that another broker had tried again has one deadline, and none when it is gone") {
    Fleet fleet(2);
    fleet.pass(4s);
    SubmitJob picture = Farm::picture(1, 4);
    picture.settings.time_limit = 1min;
    (void)fleet.submit(0, "c", picture);
    fleet.pass(1s);
    fleet.cut(0, 1);
    const auto say = [&](std::uint64_t counter, JobPhase phase) {
        JobRecord word = word_of(picture, {counter, fleet.nodes[0].id}, phase);
        word.age = 20s; // it comes late
        fleet.say(1, "broker 0", word);
        CHECK(fleet.state(1, picture.job)->phase == phase);
    };
    say(8, JobPhase::cancelled);
    say(9, JobPhase::queued);
    say(10, JobPhase::cancelled);
    fleet.kill(0);
    fleet.pass(2min); // this one leads; its time would be up
    CHECK_FALSE(fleet.has_logged(1, "job_late"));
    CHECK(fleet.state(1, picture.job)->phase == JobPhase::cancelled);
}

TEST_CASE("an end that only a leader had told of that died is not waited for") {
    Fleet fleet(3);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 1);
    const SubmitJob picture = Farm::checked(1, 4);
    (void)fleet.submit(0, "c", picture);
    fleet.pass(100ms);
    REQUIRE(fleet.render_one("w"));
    fleet.pass(3s);
    JobRecord word = word_of(picture, {99, fleet.nodes[0].id}, JobPhase::done);
    word.done_count = 4;
    word.epoch = fleet.state(2, picture.job)->epoch;
    fleet.say(2, "broker 0", word); // and nobody else hears it, nor gets its tiles
    REQUIRE(fleet.state(2, picture.job)->phase != JobPhase::done);
    fleet.kill(0);
    for (int i = 0; i < 20; ++i) {
        fleet.pass(1s);
        fleet.render_all("w");
    }
    for (std::size_t i = 1; i < 3; ++i) {
        CAPTURE(i);
        CHECK(fleet.state(i, picture.job)->phase == JobPhase::done);
    }
}

TEST_CASE("what is cancelled before it has its scene is kept: its tiles may still come") {
    Fleet fleet(2, {}, true);
    fleet.pass(4s);
    const SubmitJob picture = Farm::picture(1, 4);
    SUBCASE("a copy") {
        fleet.say(1, "broker 0", word_of(picture, {1, fleet.nodes[0].id}, JobPhase::queued));
    }
    SUBCASE("of a client of its own, that may have sent it to the other one as well") {
        fleet.say(1, "c", ClientHello{"c", "test"});
        fleet.say(1, "c", picture);
    }
    REQUIRE(fleet.state(1, picture.job)->phase == JobPhase::waiting_for_scene);
    const auto is_kept = [&] {
        return std::ranges::any_of(fleet.nodes[1].kept, [](const Write& write) {
            return std::holds_alternative<PutJob>(write);
        });
    };
    CHECK_FALSE(is_kept());
    fleet.say(1, "c", ClientHello{"c", "test"});
    fleet.say(1, "c", ControlJob{picture.job, JobDeed::cancel, 0});
    CHECK(fleet.state(1, picture.job)->phase == JobPhase::cancelled);
    CHECK(fleet.state(1, picture.job)->reason == "cancelled by a client");
    CHECK(is_kept());
}

TEST_CASE("a tile that hangs is stopped, however often its worker greets anew") {
    Limits limits;
    limits.lease = 10s;
    Fleet fleet(2, limits);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 1);
    (void)fleet.submit(0, "c", Farm::picture(1, 1));
    fleet.pass(100ms);
    REQUIRE(fleet.workers.at("w").has.size() == 1);
    fleet.workers.at("w").hangs = true;
    fleet.kill(0);
    for (int i = 0; i < 5; ++i) {
        fleet.pass(3s);
        fleet.greet(1, "w");
    }
    CHECK(!fleet.heard<CancelTile>(1, "w").empty());
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

TEST_CASE("a job that is over and forgotten elsewhere ends where it still goes on") {
    Limits limits;
    limits.keep = 1s;
    Fleet fleet(2, limits);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 1);
    SubmitJob picture = Farm::picture(1, 6);
    picture.settings.time_limit = 1min; // it has a deadline, too
    const JobId job = fleet.submit(0, "c", picture);
    fleet.render_one("w");
    fleet.pass(1s);
    fleet.cut(0, 1);
    fleet.pass(3s);
    fleet.say(1, "c", ControlJob{job, JobDeed::cancel, 0});
    fleet.pass(2s);
    CHECK_FALSE(fleet.state(1, job).has_value());
    CHECK(fleet.state(0, job)->phase == JobPhase::running);
    fleet.heal();
    fleet.pass(5s);
    CHECK_FALSE(fleet.state(0, job).has_value());
    CHECK(fleet.leaders() == std::vector<std::size_t>{0}); // which deals out what there is
    const JobId next = fleet.submit(1, "c", Farm::picture(2, 2));
    fleet.pass(100ms);
    fleet.render_all("w");
    for (std::size_t i = 0; i < 2; ++i)
        CHECK(fleet.state(i, next)->phase == JobPhase::done);
    fleet.pass(1min); // its time would be up
}

TEST_CASE("of what is drawn and forgotten nothing is left where brokers stand by, or lead") {
    Limits limits;
    limits.keep = 1s;
    Fleet fleet(3, limits);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 4);
    std::uint8_t job_ids = 0;
    const auto after_rounds = [&](int count) {
        for (int i = 0; i < count; ++i) {
            const JobId job = fleet.submit(0, "c", Farm::picture(++job_ids, 250));
            do // all know what it has, and then that it has it no more
                for (std::size_t broker = 0; broker < 3; ++broker)
                    fleet.beat(broker, "w");
            while (fleet.render_one("w"));
            REQUIRE(fleet.state(2, job)->phase == JobPhase::done);
            fleet.pass(3s);
            REQUIRE_FALSE(fleet.state(2, job).has_value());
            fleet.sent.clear();
            for (Fleet::Node& node : fleet.nodes) {
                node.stream = {};
                node.logs = {};
            }
        }
        return static_cast<double>(allocated_bytes()) / 1024;
    };
    const double before_kib = after_rounds(5);
    CHECK(after_rounds(40) < before_kib + 64); // 10,000 tiles at each of three
}

TEST_CASE("brokers die and come back in any order: every job ends, and nothing is drawn wrongly") {
    for_each_seed(24, [](Rng& rng) {
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
