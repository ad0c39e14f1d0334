#include "tests/worker/session_driver.hpp"
#include "worker/session.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <iterator>

using namespace fraja;
using namespace fraja::worker;
using namespace fraja::protocol;
using namespace std::chrono_literals;

TEST_CASE("a broker of another version ends the worker") {
    SUBCASE("refused in our version") {
        SessionDriver driver;
        (void)driver.step(Tick{});
        const auto actions =
            driver.receive(Refused{RefusalCode::version_mismatch, {}, "this is version 9"});
        REQUIRE(of_type<Finished>(actions).size() == 1);
        CHECK(of_type<Finished>(actions)[0].reason == FinishReason::version_mismatch);
        CHECK(driver.session.next_deadline() == Instant::never());
    }
    SUBCASE("refused in its own") {
        SessionDriver driver;
        (void)driver.step(Tick{});
        const auto actions = driver.step(Undecodable{{ErrorCode::version_mismatch, "version 9"}});
        CHECK(of_type<Finished>(actions).size() == 1);
    }
}

namespace {

/// Of a worker that brokers call.
Identity called_identity() {
    Identity identity = test_identity();
    identity.is_called = true;
    return identity;
}

} // namespace

TEST_CASE("a caller that is gone takes its tiles with it, and the next one is greeted at once") {
    SessionDriver driver(called_identity());
    driver.connect();
    const TestScene scene(100);
    (void)driver.receive(order(scene, 1));
    (void)driver.receive(scene.chunk(0));
    REQUIRE(of_type<StartTile>(driver.step(SceneCompiled{scene.hash})).size() == 1);
    auto actions = driver.step(CallerGone{}); // within a second of the last hello
    CHECK(of_type<StopTile>(actions).size() == 1);
    CHECK(sent<TileFailed>(actions).empty());
    const auto hellos = sent<WorkerHello>(actions);
    REQUIRE(hellos.size() == 1);
    CHECK(hellos[0].incarnation == 2);
    (void)driver.receive(welcome());
    actions = driver.receive(order(scene, 1, 3, 2)); // the scene is still on the shelf
    CHECK(of_type<StartTile>(actions).size() == 1);
}

TEST_CASE("no caller ends a worker: whoever is of another version is hung up on, for good") {
    for (const bool in_words : {true, false}) {
        CAPTURE(in_words);
        SessionDriver driver(called_identity());
        (void)driver.step(Tick{});
        const auto actions =
            in_words ? driver.receive(Refused{RefusalCode::version_mismatch, {}, "version 1"})
                     : driver.step(Undecodable{{ErrorCode::version_mismatch, "version 9"}});
        CHECK(of_type<Finished>(actions).empty());
        REQUIRE(of_type<HangUp>(actions).size() == 1);
        CHECK(of_type<HangUp>(actions)[0].for_good);
        CHECK(sent<WorkerHello>(driver.step(CallerGone{})).size() == 1);
    }
    SessionDriver driver(called_identity());
    driver.connect();
    CHECK(of_type<HangUp>(driver.receive(Dismissed{"go"})).size() == 1);
    CHECK(sent<WorkerHello>(driver.step(CallerGone{})).size() == 1);
    (void)driver.receive(welcome());
    // Its owner does.
    CHECK(of_type<Finished>(driver.step(StopNow{})).empty()); // the last beat has its answer first
    CHECK(of_type<Finished>(driver.receive(Beat{})).size() == 1);
}

TEST_CASE("a caller that does not answer leaves its turn to others and comes again") {
    SessionDriver driver(called_identity());
    std::size_t hellos = sent<WorkerHello>(driver.step(Tick{})).size();
    for (;;) {
        const auto actions = driver.pass(driver.session.next_deadline() - driver.now);
        if (const auto hung_up = of_type<HangUp>(actions); !hung_up.empty()) {
            CHECK_FALSE(hung_up[0].for_good);
            break;
        }
        hellos += sent<WorkerHello>(actions).size();
        REQUIRE(hellos < 100);
    }
    CHECK(hellos == Limits{}.hellos_per_turn);
    CHECK(sent<WorkerHello>(driver.step(CallerGone{})).size() == 1);
    // One that answers keeps it, however often it forgets the worker.
    for (int i = 0; i < 20; ++i) {
        (void)driver.receive(welcome());
        (void)driver.receive(Refused{RefusalCode::unknown_peer, {}, ""});
        const auto actions = driver.pass(2s);
        CHECK(of_type<HangUp>(actions).empty());
        CHECK(sent<WorkerHello>(actions).size() == 1);
    }
}

TEST_CASE("a worker that is leaving leaves with its caller") {
    SessionDriver driver(called_identity());
    driver.connect();
    (void)driver.receive(order(TestScene(100), 1));
    CHECK(of_type<Finished>(driver.step(Drain{})).empty());
    const auto finished = of_type<Finished>(driver.step(CallerGone{}));
    REQUIRE(finished.size() == 1);
    CHECK(finished[0].reason == FinishReason::drained);
}

TEST_CASE("draining: takes nothing more, finishes, says goodbye") {
    Ready driver;
    SUBCASE("with a tile at hand") {
        const Ticket ticket =
            of_type<StartTile>(driver.receive(order(driver.scene, 5))).at(0).ticket;
        auto actions = driver.step(Drain{});
        REQUIRE(sent<WorkerBeat>(actions).size() == 1);
        CHECK(sent<WorkerBeat>(actions)[0].credit == 0);
        CHECK(of_type<Finished>(actions).empty());
        (void)driver.receive(Beat{});
        CHECK(failure(driver.receive(order(driver.scene, 6))) ==
              "cancelled: this worker is leaving");
        CHECK(sent<WorkerBeat>(driver.pass(1s)).at(0).credit == 0);
        (void)driver.receive(Beat{});
        SUBCASE("that is finished") {
            actions = driver.step(TileFinished{ticket, {}, {}, {}});
            CHECK(sent<TileRendered>(actions).size() == 1);
            CHECK(sent<Goodbye>(actions).size() == 1);
        }
        SUBCASE("that the broker does not want") {
            actions = driver.receive(CancelTile{job_id(1), TileIndex{5}, AttemptNumber{6}});
            CHECK(sent<Goodbye>(actions).size() == 1);
        }
        SUBCASE("but no broker left to give it to") {
            actions = driver.pass(3s);
            CHECK(of_type<Send>(actions).empty());
        }
        REQUIRE(of_type<Finished>(actions).size() == 1);
        CHECK(of_type<Finished>(actions)[0].reason == FinishReason::drained);
        CHECK(driver.pass(10s).empty());
    }
    SUBCASE("with nothing at hand, once the broker has heard all") {
        CHECK(sent<Goodbye>(driver.step(Drain{})).empty());
        const auto actions = driver.receive(Beat{});
        CHECK(sent<Goodbye>(actions).size() == 1);
        CHECK(of_type<Finished>(actions).size() == 1);
    }
    SUBCASE("with nothing at hand, and a broker that does not answer") {
        (void)driver.step(Drain{});
        CHECK(driver.session.next_deadline() <= driver.now + 1s);
        const auto actions = driver.pass(1s);
        CHECK(sent<Goodbye>(actions).size() == 1);
        CHECK(of_type<Finished>(actions).size() == 1);
    }
}

TEST_CASE("draining without a connection ends at once, without a word") {
    SessionDriver driver;
    (void)driver.step(Tick{});
    const auto actions = driver.step(Drain{});
    CHECK(of_type<Send>(actions).empty());
    CHECK(of_type<Finished>(actions).size() == 1);
}

TEST_CASE("who leaves says what is at hand, how to hasten it, and what becomes of it") {
    const auto said = [](const std::vector<Action>& actions) {
        const auto lines = of_type<Log>(actions);
        REQUIRE(lines.size() == 1);
        return lines[0].text;
    };
    Ready idle;
    CHECK(said(idle.step(Drain{})) == "leaving with 0 tiles at hand");
    CHECK(of_type<Log>(idle.step(StopNow{})).empty());
    Ready busy;
    (void)busy.receive(order(busy.scene, 5));
    (void)busy.receive(order(busy.scene, 6));
    CHECK(said(busy.step(Drain{})) ==
          "leaving with 2 tiles at hand; a second INT or TERM hands them back at once");
    CHECK(said(busy.step(StopNow{})) == "hands back 2 tiles at hand");
}

TEST_CASE("stopping hands back every tile, after it has said that it takes no other") {
    for (const bool draining_before : {false, true}) {
        Ready driver;
        (void)driver.receive(order(driver.scene, 5));
        (void)driver.receive(order(TestScene(10, 'o'), 6));
        std::vector<Action> actions;
        if (draining_before)
            actions = driver.step(Drain{});
        std::ranges::move(driver.step(StopNow{}), std::back_inserter(actions));
        CHECK(of_type<StopTile>(actions).size() == 1);
        const auto sends = of_type<Send>(actions);
        REQUIRE(sends.size() == 3);
        CHECK(std::get<WorkerBeat>(sends[0].message).credit == 0);
        for (const TileFailed& failed : sent<TileFailed>(actions))
            CHECK(failed.code == FailureCode::cancelled);
        actions = driver.receive(Beat{});
        CHECK(sent<Goodbye>(actions).size() == 1);
        REQUIRE(of_type<Finished>(actions).size() == 1);
        CHECK(of_type<Finished>(actions)[0].reason == FinishReason::stopped);
    }
}
