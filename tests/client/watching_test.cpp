#include "client/watching.hpp"

#include "client/asking.hpp"
#include "tests/client/fake_farm.hpp"

#include <algorithm>
#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::client;
using namespace std::chrono_literals;

namespace {

SessionOptions session() {
    return {{"tcp://127.0.0.1:50057"}, 10s, "test"};
}

} // namespace

TEST_CASE("a watcher leaves at the share that was asked for") {
    struct Row {
        double share;
        std::size_t tiles;
    };
    for (const Row& row : {Row{0.0, 1}, Row{0.5, 40}, Row{0.99, 80}, Row{1.0, 80}}) {
        CAPTURE(row.share);
        FakeFarm farm(existing(0), {}, 1);
        JobWatching watching({"cone", session(), {.share = row.share}}, Rng(1));
        REQUIRE(farm.run(watching, 60s));
        CHECK(farm.outcome == Outcome{});
        CHECK(farm.delivered.size() == row.tiles);
    }
}

TEST_CASE("a watcher that looks once sees what is there and leaves") {
    FakeFarm farm(existing(30), {}, 1);
    JobWatching watching({"cone", session(), {.once = true}}, Rng(1));
    REQUIRE(farm.run(watching, 60s));
    CHECK(farm.outcome == Outcome{});
    CHECK(farm.delivered.size() >= 30);
    CHECK(farm.now() < Instant{} + 1s);
}

TEST_CASE("a job that is not there is an answer") {
    FakeFarm farm({}, {}, 1);
    JobWatching watching({"cone", session(), {}}, Rng(1));
    REQUIRE(farm.run(watching, 60s));
    CHECK(farm.outcome->code == ExitCode::no_such_job);
}

TEST_CASE("a watcher whose broker restarts twice in a second is not kept busy for ever") {
    JobWatching watching({"cone", session(), {}}, Rng(1));
    std::vector<Action> actions;
    watching.start(Instant{}, actions);
    const auto hear = [&](protocol::Message message) {
        watching.step(Instant{}, FromBroker{std::move(message)}, actions);
    };
    protocol::Welcome welcome;
    welcome.epoch = 1;
    welcome.heartbeat = 1s;
    welcome.liveness = 3;
    hear(welcome);
    protocol::JobState state;
    state.epoch = 1;
    state.phase = protocol::JobPhase::running;
    state.cell_side = 128; // of 256 x 192 pixels
    state.cell_count = 4;
    hear(state);
    welcome.epoch = 2;
    hear(welcome);
    hear(protocol::Refused{protocol::RefusalCode::no_such_job, state.job, "no such job"});
    welcome.epoch = 3;
    hear(welcome);
    const Instant due = Instant{} + 1s;
    for (int i = 0; i < 3; ++i)
        watching.step(due, Tick{}, actions);
    CHECK(watching.next_deadline() > due);
}

TEST_CASE("a question is asked until it is answered") {
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
        CAPTURE(seed);
        FakeFarm farm(existing(3), {.session_drop = 0.6, .heal_after = 8s}, seed);
        Asking asking(JobQuestion{"cone", protocol::JobDeed::cancel}, session());
        const bool over = farm.run(asking, 60s);
        REQUIRE(over);
        if (farm.outcome->code == ExitCode::unreachable)
            continue; // ten seconds without a Welcome: so it is said
        CHECK(farm.outcome == Outcome{});
        CHECK(is_over(farm.states.back().phase));
    }
}

TEST_CASE("what is found twice is no answer to what was asked since") {
    Asking asking(JobQuestion{"cone", protocol::JobDeed::cancel}, session());
    std::vector<Action> actions;
    asking.start(Instant{}, actions);
    const auto hear = [&](protocol::Message message) {
        actions.clear();
        asking.step(Instant{} + 3s, FromBroker{std::move(message)}, actions);
    };
    const auto is_over = [&] {
        return std::ranges::any_of(actions, [](const Action& action) {
            const auto* news = std::get_if<News>(&action);
            return news && std::holds_alternative<Finished>(*news);
        });
    };
    protocol::Welcome welcome;
    welcome.heartbeat = 10s;
    welcome.liveness = 3;
    hear(welcome);
    asking.step(Instant{} + 6s, Tick{}, actions); // no answer yet: it asks again
    protocol::JobState state;
    state.phase = protocol::JobPhase::running;
    hear(state); // to the first FindJob
    CHECK_FALSE(is_over());
    hear(state); // to the second
    CHECK_FALSE(is_over());
    hear(state); // which comes twice
    CHECK_FALSE(is_over());
    state.phase = protocol::JobPhase::cancelled;
    hear(state);
    CHECK(is_over());
}
