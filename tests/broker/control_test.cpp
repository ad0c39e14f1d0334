// What people want of jobs and workers, and what becomes of workers that fail.
#include "common/protocol/limits.hpp"
#include "tests/broker/farm.hpp"

namespace fraja::broker {
namespace {

using namespace protocol;
using namespace std::chrono_literals;

JobState control(Farm& farm, const JobId& job, JobDeed deed, std::int32_t priority = 0) {
    farm.forget("client");
    farm.say("client", ControlJob{job, deed, priority});
    return farm.last<JobState>("client");
}

WorkerState control(Farm& farm, const std::string& worker, WorkerDeed deed) {
    farm.client_arrives("admin");
    farm.forget("admin");
    farm.say("admin", ControlWorker{worker, deed});
    return farm.last<FarmState>("admin").workers.at(0);
}

WorkerState state_of(Farm& farm, const std::string& worker) {
    farm.event(TopicSubscribed{std::string(farm_topic)});
    farm.pass(600ms);
    const auto farms = farm.published<FarmState>(std::string(farm_topic));
    for (const WorkerState& state : farms.back().workers)
        if (state.worker_name == worker)
            return state;
    FAIL("no such worker");
    return {};
}

TEST_CASE("a paused job keeps what it has, takes what comes, and gets nothing new") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 2);
    const JobId job = farm.submit(1, 5);
    const auto tiles = farm.tiles("w");
    CHECK(control(farm, job, JobDeed::pause).phase == JobPhase::paused);
    const std::size_t logged = farm.logs.size();
    CHECK(farm.logs.back().text == "job #1 picture1 " + to_string(job) + " is paused");
    CHECK(control(farm, job, JobDeed::pause).phase == JobPhase::paused);
    CHECK(farm.logs.size() == logged); // it was
    farm.render("w", tiles[0]);
    farm.fail("w", tiles[1], FailureCode::machine);
    CHECK(farm.tiles("w").empty());
    CHECK(farm.state(job).done_count == 1);
    CHECK(control(farm, job, JobDeed::resume).phase == JobPhase::queued);
    CHECK(farm.tiles("w").size() == 2);
    CHECK(farm.state(job).phase == JobPhase::running);
}

TEST_CASE("a job that is paused with its last tiles out is done when they come") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 2);
    const JobId job = farm.submit(1, 2);
    const auto tiles = farm.tiles("w");
    (void)control(farm, job, JobDeed::pause);
    farm.render("w", tiles[0]);
    farm.render("w", tiles[1]);
    CHECK(farm.state(job).phase == JobPhase::done);
}

TEST_CASE("what was cancelled or failed goes on with what it has when it is tried again") {
    for (const bool cancelled : {true, false}) {
        CAPTURE(cancelled);
        Farm farm;
        farm.worker_arrives("w", 1, 1, 1);
        const JobId job = farm.submit(1, 3);
        farm.render("w", farm.tiles("w").at(0));
        if (cancelled) {
            const auto tile = farm.tiles("w").at(0);
            (void)control(farm, job, JobDeed::cancel);
            farm.fail("w", tile, FailureCode::cancelled);
        } else {
            farm.fail("w", farm.tiles("w").at(0), FailureCode::scene);
        }
        CHECK(is_over(farm.state(job).phase));
        CHECK(farm.tiles("w").empty());
        const JobState state = control(farm, job, JobDeed::retry);
        CHECK_FALSE(is_over(state.phase));
        CHECK(state.reason.empty());
        CHECK(state.done_count == 1);
        for (int i = 0; i < 2; ++i)
            farm.render("w", farm.tiles("w").at(0));
        CHECK(farm.state(job).phase == JobPhase::done);
    }
}

TEST_CASE("a job is taken over by whoever submits the same picture and says so") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 1);
    const JobId first = farm.submit(1, 3);
    SubmitJob again = Farm::picture(2, 3);
    again.job_name = "another name";
    again.resume = true;
    farm.client_arrives("late");
    farm.say("late", again);
    CHECK(farm.last<JobState>("late").job == first);
    CHECK(farm.dispatcher.job_count() == 1);
    again.job = first; // as it goes on
    farm.say("late", again);
    CHECK_FALSE(farm.heard<Refused>("late"));
    farm.say("client", ControlJob{first, JobDeed::cancel, 0});
    farm.say("late", again);
    CHECK_FALSE(is_over(farm.last<JobState>("late").phase)); // it is tried again
    SubmitJob other = again;
    other.job = id_of<JobId>(3);
    other.settings.depth += 1;
    farm.say("late", other);
    CHECK(farm.last<JobState>("late").job == other.job);
    CHECK(farm.dispatcher.job_count() == 2);
    other.job = first;
    farm.say("late", other);
    CHECK(farm.last<Refused>("late").code == RefusalCode::conflict);
}

TEST_CASE("what cannot be done with a job is refused with the reason") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 1);
    const JobId job = farm.submit(1, 1);
    struct Row {
        JobDeed deed;
        bool over, refused;
    };
    for (const Row& row : {Row{JobDeed::resume, false, false}, Row{JobDeed::retry, false, true},
                           Row{JobDeed::pause, true, true}, Row{JobDeed::resume, true, true},
                           Row{JobDeed::retry, true, true}, Row{JobDeed::cancel, true, false}}) {
        CAPTURE(static_cast<int>(row.deed));
        if (row.over && !is_over(farm.state(job).phase))
            farm.render("w", farm.tiles("w").at(0));
        farm.forget("client");
        farm.say("client", ControlJob{job, row.deed, 0});
        CHECK(farm.heard<Refused>("client") == row.refused);
    }
    farm.say("client", ControlJob{id_of<JobId>(9), JobDeed::pause, 0});
    CHECK(farm.last<Refused>("client").code == RefusalCode::no_such_job);
}

TEST_CASE("a priority that is changed counts from then on") {
    Farm farm;
    farm.submit(1, 4);
    const JobId second = farm.submit(2, 4);
    CHECK(control(farm, second, JobDeed::set_priority, 3).priority == 3);
    farm.worker_arrives("w", 1, 1, 3);
    for (const auto& tile : farm.tiles("w"))
        CHECK(tile.job == second);
}

TEST_CASE("a drained worker finishes what it has and gets nothing, until it is undrained") {
    Farm farm;
    farm.worker_arrives("ada", 1, 1, 2);
    const JobId job = farm.submit(1, 6);
    const auto tiles = farm.tiles("ada");
    CHECK(control(farm, "ada", WorkerDeed::drain).draining);
    farm.render("ada", tiles[0]);
    farm.beat("ada", 2, {tiles[1]});
    CHECK(farm.tiles("ada").empty());
    CHECK(farm.state(job).done_count == 1);
    CHECK_FALSE(control(farm, to_string(id_of<WorkerId>(1)), WorkerDeed::undrain).draining);
    CHECK(farm.tiles("ada").size() == 1);
}

TEST_CASE(
    "a worker that loses its connection is still drained when it comes back, for absence_max") {
    for (const bool in_time : {true, false}) {
        CAPTURE(in_time);
        Farm farm;
        farm.worker_arrives("ada", 1, 1, 2);
        CHECK(control(farm, "ada", WorkerDeed::drain).draining);
        farm.event(PeerUnreachable{"ada"});
        farm.pass(farm.limits.absence_max + (in_time ? -1s : 1s));
        farm.worker_arrives("ada again", 1, 1, 2);
        farm.submit(1, 2);
        CHECK(farm.tiles("ada again").empty() == in_time);
    }
}

TEST_CASE("a worker that is gone is undrained for when it comes back") {
    Farm farm;
    for (const auto& [peer, id] : {std::pair("ada", 1), std::pair("bob", 2), std::pair("ada", 3)}) {
        farm.worker_arrives(peer, static_cast<std::uint8_t>(id), 1, 1);
        CHECK(control(farm, peer, WorkerDeed::drain).draining);
        farm.event(PeerUnreachable{peer});
    }
    CHECK_FALSE(control(farm, "ada", WorkerDeed::undrain).draining); // either process of that name
    farm.submit(1, 3);
    farm.worker_arrives("bob again", 2, 1, 1);
    CHECK(farm.tiles("bob again").empty());
    for (const std::uint8_t id : {std::uint8_t{1}, std::uint8_t{3}}) {
        const PeerId peer = "ada again " + std::to_string(id);
        farm.worker_arrives(peer, id, 1, 1);
        CHECK(farm.tiles(peer).size() == 1);
    }
}

TEST_CASE("what a worker failed before it lost its connection counts when it is back") {
    Farm farm(Limits{.attempts_max = 1'000});
    farm.worker_arrives("bad", 1, 1, 1);
    farm.worker_arrives("good", 2, 1, 1);
    farm.submit(1, 40);
    for (int i = 0; i < 2; ++i)
        farm.fail("bad", farm.tiles("bad").at(0), FailureCode::machine);
    farm.event(PeerUnreachable{"bad"});
    farm.worker_arrives("bad again", 1, 1, 1);
    farm.fail("bad again", farm.tiles("bad again").at(0), FailureCode::machine);
    CHECK(farm.dispatcher.counters().workers_quarantined == 1);
    farm.event(PeerUnreachable{"bad again"});
    farm.worker_arrives("and again", 1, 1, 1);
    CHECK(farm.tiles("and again").empty());
}

TEST_CASE("of workers that are gone no more than workers_max are remembered") {
    Farm farm(Limits{.workers_max = 2});
    for (std::uint8_t id = 1; id <= 3; ++id) { // the first goes first
        const PeerId peer = "w" + std::to_string(id);
        farm.worker_arrives(peer, id, 1, 1);
        CHECK(control(farm, peer, WorkerDeed::drain).draining);
        farm.event(PeerUnreachable{peer});
        farm.pass(1s);
    }
    farm.submit(1, 2);
    farm.worker_arrives("third", 3, 1, 1);
    CHECK(farm.tiles("third").empty());
    farm.worker_arrives("first", 1, 1, 1);
    CHECK(farm.tiles("first").size() == 1);
}

TEST_CASE("what was dealt out to a worker that is drained goes to the others") {
    Farm farm;
    farm.worker_arrives("a", 1, 1, 1);
    farm.worker_arrives("b", 2, 1, 1);
    SubmitJob s = Farm::picture(1, 8);
    s.wishes.schedule = Schedule::equal;
    const JobId job = farm.submit("client", s);
    const auto last = farm.tiles("b");
    CHECK(control(farm, "b", WorkerDeed::drain).draining);
    farm.render("b", last.at(0));
    farm.render_all("a");
    CHECK(farm.state(job).phase == JobPhase::done);
}

TEST_CASE("a kicked worker is told to leave and its tiles go to others") {
    Farm farm;
    farm.worker_arrives("ada", 1, 1, 2);
    farm.submit(1, 2);
    (void)farm.tiles("ada");
    farm.worker_arrives("bob", 2, 1, 2);
    (void)control(farm, "ada", WorkerDeed::kick);
    CHECK(farm.heard<Dismissed>("ada"));
    CHECK(farm.dispatcher.worker_count() == 1);
    CHECK(farm.tiles("bob").size() == 2);
}

TEST_CASE("a worker is found by its name, its id or the beginning of that, if there is but one") {
    Farm farm;
    farm.worker_arrives("ada", 1, 1, 2);
    farm.worker_arrives("bob", 2, 1, 2);
    farm.client_arrives("admin");
    struct Row {
        const char* what;
        RefusalCode code;
    };
    for (const Row& row :
         {Row{"eve", RefusalCode::no_such_worker}, Row{"", RefusalCode::no_such_worker},
          Row{"0000", RefusalCode::invalid}}) {
        CAPTURE(row.what);
        farm.forget("admin");
        farm.say("admin", ControlWorker{row.what, WorkerDeed::drain});
        CHECK(farm.last<Refused>("admin").code == row.code);
    }
    for (const WorkerDeed deed : {WorkerDeed::drain, WorkerDeed::undrain}) { // a reason has room
        farm.forget("admin");
        farm.say("admin", ControlWorker{std::string(string_bytes_max, 'x'), deed});
        CHECK(farm.last<Refused>("admin").code == RefusalCode::no_such_worker);
    }
}

TEST_CASE("a worker that fails too often is quarantined for a while, and that is announced") {
    Limits limits;
    limits.attempts_max = 1'000;
    Farm farm(limits);
    farm.worker_arrives("bad", 1, 1, 1);
    farm.worker_arrives("good", 2, 1, 1);
    farm.submit(1, 40);
    for (int i = 0; i < 3; ++i)
        farm.fail("bad", farm.tiles("bad").at(0), FailureCode::machine);
    CHECK(farm.tiles("bad").empty());
    CHECK(farm.dispatcher.counters().workers_quarantined == 1);
    CHECK(std::ranges::any_of(farm.logs, [](const Log& log) {
        return log.text.find("worker bad has failed 3 tiles: it gets none for 10:00") !=
               std::string::npos;
    }));
    CHECK(state_of(farm, "bad").quarantined > 9min);
    const auto held = farm.tiles("good");
    const Instant begin = farm.now;
    for (std::uint64_t i = 1; i < 2'000 && !farm.heard<RenderTile>("bad"); ++i) {
        farm.now = farm.now + 400ms;
        farm.beat("bad", 1, {});
        farm.beat("good", 1, held, i);
    }
    CHECK(farm.tiles("bad").size() == 1); // it is over
    CHECK(farm.now - begin > 9min);
    CHECK(farm.now - begin < 11min);
    CHECK(state_of(farm, "bad").quarantined == 0s);
}

TEST_CASE("the last worker is never quarantined, and a quarantine ends when the others leave") {
    Limits limits;
    limits.attempts_max = 1'000;
    Farm farm(limits);
    farm.worker_arrives("one", 1, 1, 1);
    farm.submit(1, 40);
    for (int i = 0; i < 20; ++i)
        farm.fail("one", farm.tiles("one").at(0), FailureCode::machine);
    CHECK(farm.tiles("one").size() == 1);
    CHECK(farm.dispatcher.counters().workers_quarantined == 0);
    farm.worker_arrives("two", 2, 1, 1);
    for (int i = 0; i < 3; ++i)
        farm.fail("two", farm.tiles("two").at(0), FailureCode::machine);
    CHECK(farm.tiles("two").empty());
    farm.event(PeerUnreachable{"one"});
    farm.pass(600ms);
    CHECK(farm.tiles("two").size() == 1);
}

TEST_CASE("failures long ago do not count") {
    Limits limits;
    limits.attempts_max = 1'000;
    limits.quarantine_window = 10s;
    Farm farm(limits);
    farm.worker_arrives("bad", 1, 1, 1);
    farm.worker_arrives("good", 2, 1, 1);
    farm.submit(1, 40);
    auto held = farm.tiles("good");
    for (std::uint64_t i = 0; i < 40; ++i) {
        const auto tiles = farm.tiles("bad");
        REQUIRE(tiles.size() == 1);
        if (i % 10 == 0)
            farm.fail("bad", tiles[0], FailureCode::machine);
        else
            farm.render("bad", tiles[0]);
        farm.now = farm.now + 1s;
        farm.beat("good", 1, held, i + 1);
    }
    CHECK(farm.dispatcher.counters().workers_quarantined == 0);
}

} // namespace
} // namespace fraja::broker
