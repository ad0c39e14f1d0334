#include "tests/worker/session_driver.hpp"
#include "worker/session.hpp"

#include <doctest/doctest.h>
#include <set>

using namespace fraja;
using namespace fraja::worker;
using namespace fraja::protocol;
using namespace std::chrono_literals;

TEST_CASE("session greets at once, with all it has to say, and grants two tiles a thread") {
    SessionDriver driver;
    const auto hellos = sent<WorkerHello>(driver.step(Tick{}));
    REQUIRE(hellos.size() == 1);
    CHECK(hellos[0].worker == test_identity().worker);
    CHECK(hellos[0].worker_name == "tester");
    CHECK(hellos[0].threads == 2);
    CHECK(hellos[0].credit == 4);
    CHECK(hellos[0].tags == std::vector<std::string>{"fast", "os=x"});
    CHECK(hellos[0].incarnation == 1);
    CHECK(hellos[0].memory_bytes == 0);
    Identity small = test_identity();
    small.memory_bytes = 1'000;
    CHECK(sent<WorkerHello>(SessionDriver(small).step(Tick{})).at(0).memory_bytes == 1'000);
}

TEST_CASE("credit_for stays within the wire's limit") {
    CHECK(credit_for(1, {}) == 2);
    CHECK(credit_for(threads_max, {}) <= credit_max);
    Limits greedy;
    greedy.prefetch_per_thread = UINT32_MAX;
    CHECK(credit_for(UINT32_MAX, greedy) == credit_max);
}

TEST_CASE("session greets an absent broker ever more rarely, and says so once") {
    SessionDriver driver;
    (void)driver.step(Tick{});
    std::size_t warnings = 0;
    std::uint64_t incarnation = 1;
    for (int i = 0; i < 50; ++i) {
        const Duration pause = driver.session.next_deadline() - driver.now;
        CHECK(pause >= 500ms);
        CHECK(pause <= 5s);
        if (i > 5)
            CHECK(pause >= 2500ms);
        const auto actions = driver.pass(pause);
        const auto hellos = sent<WorkerHello>(actions);
        REQUIRE(hellos.size() == 1);
        CHECK(hellos[0].incarnation == ++incarnation);
        warnings += of_type<Log>(actions).size();
    }
    CHECK(warnings == 1);
}

TEST_CASE("two workers do not greet an absent broker in step") {
    Identity other = test_identity();
    other.worker.bytes[9] = 1;
    SessionDriver a, b(other);
    (void)a.step(Tick{});
    (void)b.step(Tick{});
    CHECK(a.session.next_deadline() != b.session.next_deadline());
}

TEST_CASE("session beats once a heartbeat and tells how far its tiles are") {
    Ready driver;
    const Ticket ticket = of_type<StartTile>(driver.receive(order(driver.scene, 5))).at(0).ticket;
    (void)driver.receive(order(driver.scene, 6));
    driver.now = driver.now + 1s;
    const auto beats = sent<WorkerBeat>(driver.step(Tick{{{ticket, 1234}, {Ticket{77}, 1}}}));
    REQUIRE(beats.size() == 1);
    CHECK(beats[0].credit == 4);
    CHECK(beats[0].in_flight ==
          std::vector{
              TileInFlight{job_id(1), TileIndex{5}, AttemptNumber{6}, 1234, 0, {0, 0, 16, 16}},
              TileInFlight{job_id(1), TileIndex{6}, AttemptNumber{7}, 0, 0, {0, 0, 16, 16}}});
    CHECK(sent<WorkerBeat>(driver.pass(500ms)).empty());
    CHECK(sent<WorkerBeat>(driver.pass(500ms)).size() == 1);
}

TEST_CASE("a broker that does not know the worker is greeted anew, and what there was is dropped") {
    Ready driver;
    (void)driver.receive(order(driver.scene, 5));
    driver.now = driver.now + 5s;
    (void)driver.receive(Beat{});
    driver.now = driver.now + 1s;
    const auto actions = driver.receive(Refused{RefusalCode::unknown_peer, {}, "hello?"});
    CHECK(of_type<StopTile>(actions).size() == 1);
    REQUIRE(sent<WorkerHello>(actions).size() == 1);
    CHECK(sent<WorkerHello>(actions)[0].incarnation == 2);
    CHECK(of_type<Send>(actions).size() == 1);
    SUBCASE("further refusals of what was sent before change nothing") {
        CHECK(driver.receive(Refused{RefusalCode::unknown_peer, {}, "hello?"}).empty());
    }
    SUBCASE("the scene is still here when it is wanted again") {
        (void)driver.receive(welcome());
        CHECK(of_type<StartTile>(driver.receive(order(driver.scene, 5, 7))).size() == 1);
    }
}

TEST_CASE("a broker that welcomes and forgets by turns is not greeted faster than an absent one") {
    SessionDriver driver;
    driver.connect();
    CHECK(sent<WorkerHello>(driver.receive(Refused{RefusalCode::unknown_peer, {}, ""})).empty());
    CHECK(driver.session.next_deadline() - driver.now == 1s);
    CHECK(sent<WorkerHello>(driver.pass(1s)).size() == 1);
}

TEST_CASE("a silent broker is lost, and greeted until it answers") {
    Ready driver;
    (void)driver.receive(order(driver.scene, 5));
    CHECK(sent<WorkerHello>(driver.pass(2999ms)).empty());
    auto actions = driver.pass(1ms);
    CHECK(of_type<StopTile>(actions).size() == 1);
    CHECK(sent<WorkerHello>(actions).size() == 1);
    CHECK(of_type<Log>(actions).size() == 1);
    actions = driver.receive(welcome());
    CHECK(of_type<Log>(actions).size() == 1);
    CHECK(sent<WorkerBeat>(driver.pass(1s)).at(0).in_flight.empty());
}

TEST_CASE("a Welcome that comes twice drops nothing in silence: the broker is greeted anew") {
    Ready driver;
    (void)driver.receive(order(driver.scene, 5));
    auto actions = driver.receive(welcome());
    CHECK(of_type<StopTile>(actions).size() == 1);
    CHECK(of_type<Send>(actions).empty());
    CHECK(of_type<Send>(driver.receive(welcome())).empty()); // nor by a third one
    CHECK(of_type<Send>(driver.receive(order(driver.scene, 6))).empty());
    actions = driver.pass(1s);
    REQUIRE(sent<WorkerHello>(actions).size() == 1);
    CHECK(sent<WorkerHello>(actions)[0].incarnation == 2);
    CHECK(of_type<Send>(actions).size() == 1);
    SUBCASE("nor does it bring back one that leaves") {
        (void)driver.receive(welcome());
        const Ticket ticket =
            of_type<StartTile>(driver.receive(order(driver.scene, 7))).at(0).ticket;
        (void)driver.step(Drain{});
        CHECK(driver.receive(welcome()).empty());
        CHECK(sent<TileRendered>(driver.step(TileFinished{ticket, {}, {}, {}})).size() == 1);
    }
}

TEST_CASE("a Welcome to an earlier hello opens nothing, and its tiles are not taken") {
    SessionDriver driver;
    const TestScene scene(10);
    (void)driver.step(Tick{});
    CHECK(sent<WorkerHello>(driver.pass(2s)).size() == 1);
    CHECK(driver.incarnation == 2);
    Welcome late = welcome();
    late.incarnation = 1;
    CHECK(of_type<Send>(driver.receive(late)).empty());
    CHECK(of_type<Send>(driver.receive(order(scene, 1))).empty());
    (void)driver.receive(welcome());
    CHECK(sent<NeedChunk>(driver.receive(order(scene, 1, 3))).size() == 1);
    const auto beats = sent<WorkerBeat>(driver.pass(1s));
    REQUIRE(beats.size() == 1);
    CHECK(beats[0].tiles_received == 1);
    CHECK(beats[0].in_flight.size() == 1);
}

TEST_CASE("a hello that is refused for another reason is tried again") {
    SessionDriver driver;
    (void)driver.step(Tick{});
    CHECK(of_type<Log>(driver.receive(Refused{RefusalCode::limit_exceeded, {}, "full"})).size() ==
          1);
    CHECK(sent<WorkerHello>(driver.pass(1s)).size() == 1);
}

TEST_CASE("all rubbish is one kind of event, which the log counts") {
    SessionDriver driver;
    driver.connect();
    for (const auto& actions :
         {driver.step(Undecodable{{ErrorCode::malformed_frame, "?"}}), driver.receive(SubmitJob{})})
        for (const Log& line : of_type<Log>(actions)) {
            CHECK(line.kind == "oddity");
            CHECK(line.subject.empty());
        }
}

TEST_CASE("hostile heartbeats are taken as the nearest that makes sense") {
    for (const Duration heartbeat : {Duration::min(), Duration::zero(), Duration::max()})
        for (const std::uint32_t liveness : {0u, UINT32_MAX}) {
            SessionDriver driver;
            (void)driver.step(Tick{});
            Welcome message = welcome();
            message.heartbeat = heartbeat;
            message.liveness = liveness;
            (void)driver.receive(message);
            CHECK(driver.session.next_deadline() > driver.now);
            CHECK(driver.session.next_deadline() <= driver.now + 1h);
        }
}

TEST_CASE("a broker of the version before is greeted in that, and so again each time") {
    using protocol::RefusalCode;
    constexpr protocol::Version older = protocol::oldest_version_spoken;
    const Received refused{protocol::Refused{RefusalCode::version_mismatch, {}, "11"}, older};
    const auto hellos = [](const std::vector<Action>& actions) {
        std::vector<protocol::Version> versions;
        for (const Action& action : actions)
            if (const auto* send = std::get_if<Send>(&action))
                if (std::holds_alternative<protocol::WorkerHello>(send->message))
                    versions.push_back(send->version);
        return versions;
    };
    const auto spoken = [](const std::vector<Action>& actions) {
        std::set<protocol::Version> versions;
        for (const Action& action : actions)
            if (const auto* send = std::get_if<Send>(&action))
                versions.insert(send->version);
        return versions;
    };
    using Versions = std::vector<protocol::Version>;
    SessionDriver driver;
    CHECK(hellos(driver.step(Tick{})) == Versions{protocol::version});
    auto actions = driver.step(refused);
    CHECK(hellos(actions) == Versions{older}); // at once
    CHECK(of_type<Log>(actions).empty());
    CHECK(driver.step(refused).empty()); // it comes twice, as a hello may have
    actions = driver.step(Received{[&] {
                                       auto w = welcome();
                                       w.incarnation = driver.incarnation;
                                       return w;
                                   }(),
                                   older});
    REQUIRE(driver.session.is_connected());
    CHECK(of_type<Log>(actions).at(0).text.ends_with(", by protocol version 11"));
    CHECK(spoken(driver.pass(1s)) == std::set{older});
    CHECK(driver.step(refused).empty()); // late
    CHECK(driver.session.is_connected());
    // It is gone, and whoever comes in its place may be a newer one.
    CHECK(hellos(driver.pass(1h)) == Versions{protocol::version});
    // Without an answer, it begins anew each time.
    (void)driver.step(refused);
    CHECK(hellos(driver.pass(10s)) == Versions{protocol::version});
    // In its own version: it is meant.
    actions = driver.receive(protocol::Refused{RefusalCode::version_mismatch, {}, "no"});
    CHECK(of_type<Finished>(actions).at(0).reason == FinishReason::version_mismatch);
}

TEST_CASE("an older broker may come in the place of a newer one, and is served") {
    SessionDriver driver;
    driver.connect();
    const auto actions =
        driver.step(Received{protocol::Refused{protocol::RefusalCode::version_mismatch, {}, "11"},
                             protocol::oldest_version_spoken});
    CHECK_FALSE(driver.session.is_connected());
    const auto sends = of_type<Send>(actions);
    REQUIRE(sends.size() == 1);
    CHECK(std::holds_alternative<protocol::WorkerHello>(sends[0].message));
    CHECK(sends[0].version == protocol::oldest_version_spoken);
}
