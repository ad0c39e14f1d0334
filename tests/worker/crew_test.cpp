// What a crew owes to brokers that stand for each other: a test for each rule.
#include "common/protocol/codec.hpp"
#include "tests/worker/crew_driver.hpp"
#include "worker/crew.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <iterator>
#include <set>

using namespace fraja;
using namespace fraja::worker;
using namespace fraja::protocol;
using namespace std::chrono_literals;

namespace {

/// Endpoints that were to be connected to.
std::vector<std::string> opened(const std::vector<CrewAction>& actions) {
    std::vector<std::string> endpoints;
    for (const CrewAction& action : actions)
        if (const auto* open = std::get_if<Open>(&action.deed))
            endpoints.push_back(open->endpoint);
    return endpoints;
}

std::size_t count_closed(const std::vector<CrewAction>& actions) {
    return static_cast<std::size_t>(std::ranges::count_if(actions, [](const CrewAction& action) {
        return std::holds_alternative<Close>(action.deed);
    }));
}

/// Tiles that the next beat of that session names.
std::vector<TileIndex> named(const std::vector<CrewAction>& actions, std::uint32_t by) {
    const auto beats = sent<WorkerBeat>(actions, by);
    REQUIRE(beats.size() == 1);
    std::vector<TileIndex> tiles;
    for (const TileInFlight& tile : beats[0].in_flight)
        tiles.push_back(tile.tile);
    std::ranges::sort(tiles);
    return tiles;
}

using Tiles = std::vector<TileIndex>;

TileFinished finished(Ticket ticket) {
    return {ticket, {}, 1ms, {Blob(Bytes(12))}};
}

} // namespace

// --------------------------------------------------------------------------------------- who is
// served

TEST_CASE("a broker that another one tells of is served as well, as the same worker") {
    CrewDriver driver;
    const auto first = sent<WorkerHello>(driver.step(CrewTick{}), 0);
    REQUIRE(first.size() == 1);
    const auto actions = driver.receive(0, welcome_of(1, members({1, 2})));
    CHECK(opened(actions) == std::vector{endpoint_of(2)});
    const auto lines = of_type<Log>(actions, 1);
    REQUIRE(lines.size() == 1);
    CHECK(lines[0].text == "served as well: tcp://broker1:50057 tells of it");
    const auto second = sent<WorkerHello>(actions, 1);
    REQUIRE(second.size() == 1);
    CHECK(second[0].worker == first[0].worker);
    CHECK(second[0].worker_name == first[0].worker_name);
    // Whoever tells of it again, or of those that it knows by their ids, opens nothing.
    CHECK(opened(driver.receive(1, welcome_of(2, members({1, 2})))).empty());
    CHECK(opened(driver.receive(0, Brokers{{}, members({1, 2})})).empty());
    CHECK(opened(driver.receive(0, Brokers{{}, {{broker_id(2), "tcp://10.0.0.2:50057"}}})).empty());
    CHECK(driver.crew.sessions() == std::vector{session(0), session(1)});
}

TEST_CASE("of a list no more is taken than a sound broker tells") {
    CrewDriver driver;
    (void)driver.step(CrewTick{});
    std::vector<Member> list{{broker_id(9), ""}}; // it cannot say where that is
    for (std::uint8_t number = 10; number < 10 + 2 * brokers_max; ++number)
        list.push_back({broker_id(number), endpoint_of(number)});
    CHECK(opened(driver.receive(0, welcome_of(1, list))).size() == brokers_max - 1);
    // Nor by and by.
    std::vector<Member> others;
    for (std::uint8_t number = 100; number < 100 + brokers_max; ++number)
        others.push_back({broker_id(number), endpoint_of(number)});
    CHECK(opened(driver.receive(0, Brokers{{}, others})).size() == 1);
    CHECK(driver.crew.sessions().size() <= crew_sessions_max(1, false, false));
    // Those that are not told of any more make room.
    CHECK(opened(driver.receive(0, Brokers{{}, others})).size() == brokers_max - 1);
}

TEST_CASE("a broker that no broker tells of any more is let go of, unless it was given") {
    CrewDriver driver(2);
    (void)driver.step(CrewTick{});
    (void)driver.receive(0, welcome_of(1, members({1, 2, 3})));
    REQUIRE(driver.crew.sessions().size() == 3);
    SUBCASE("that does not answer") {
        const auto actions = driver.receive(0, Brokers{{}, members({1})});
        CHECK(of_type<Close>(actions, 2).size() == 1);
        CHECK(count_closed(actions) == 1);
        CHECK(sent<Goodbye>(actions, 2).empty());
    }
    SUBCASE("that is there, and says that it stands alone") {
        (void)driver.receive(2, welcome_of(3, members({1, 2, 3})));
        CHECK(count_closed(driver.receive(0, Brokers{{}, members({1})})) == 0); // it says so itself
        const auto actions = driver.receive(2, Brokers{{}, {}});
        CHECK(of_type<Close>(actions, 2).size() == 1);
        CHECK(sent<Goodbye>(actions, 2).size() == 1);
    }
    SUBCASE("but not for the silence of those that are lost") {
        (void)driver.receive(0, Refused{RefusalCode::unknown_peer, {}, ""});
        (void)driver.pass(1s);
        CHECK(driver.crew.sessions().size() == 3);
        CHECK(count_closed(driver.receive(1, welcome_of(2, {}))) == 0); // another farm
        CHECK(count_closed(driver.receive(0, welcome_of(1, members({1})))) == 1);
    }
    CHECK(driver.crew.sessions() == std::vector{session(0), session(1)});
    // When it is told of again it has a session again.
    const auto again = driver.crew.is_connected(session(0))
                           ? driver.receive(0, Brokers{{}, members({1, 3})})
                           : std::vector<CrewAction>{};
    CHECK(opened(again) == std::vector{endpoint_of(3)});
}

TEST_CASE("a broker that is told of again hears newer hellos than those that it may remember") {
    CrewDriver driver;
    (void)driver.step(CrewTick{});
    (void)driver.receive(0, welcome_of(1, members({1, 2})));
    (void)driver.pass_with_beats(1min, {0});
    const std::uint64_t last = driver.incarnations[session(1)];
    CHECK(last > 5);
    REQUIRE(count_closed(driver.receive(0, Brokers{{}, members({1})})) == 1);
    const auto hellos = sent<WorkerHello>(driver.receive(0, Brokers{{}, members({1, 2})}), 1);
    REQUIRE(hellos.size() == 1);
    CHECK(hellos[0].incarnation == last + 1);
}

TEST_CASE("an endpoint that cannot be connected to is left alone until another broker has it") {
    CrewDriver driver;
    (void)driver.step(CrewTick{});
    std::vector<Member> list{{broker_id(2), "rubbish"}};
    REQUIRE(opened(driver.receive(0, welcome_of(1, list))).size() == 1);
    CHECK(of_type<Close>(driver.step(NotOpened{session(1)}), 1).size() == 1);
    CHECK(opened(driver.receive(0, Brokers{{}, list})).empty());
    list[0].broker = broker_id(3);
    CHECK(opened(driver.receive(0, Brokers{{}, list})).size() == 1);
    CHECK_FALSE(driver.crew.finished());
}

TEST_CASE("a worker that is called serves its callers alone") {
    Identity identity = test_identity();
    identity.is_called = true;
    CrewDriver driver(1, identity);
    (void)driver.step(CrewTick{});
    CHECK(opened(driver.receive(0, welcome_of(1, members({1, 2})))).empty());
    CHECK(sent<WorkerHello>(driver.step(0, CallerGone{}), 0).size() == 1);
    CHECK(crew_sessions_max(1, true, false) == 1);
}

TEST_CASE("two endpoints of one broker are served by one session") {
    SUBCASE("found out by its id: the later one goes, and the broker hears from the first again") {
        CrewDriver driver(2);
        (void)driver.step(CrewTick{});
        (void)driver.receive(0, welcome_of(1));
        auto actions = driver.receive(1, welcome_of(1));
        CHECK(of_type<Close>(actions, 1).size() == 1);
        CHECK(sent<Goodbye>(actions, 1).size() ==
              1); // after which it has no session of this worker
        CHECK_FALSE(driver.crew.is_connected(session(0)));
        CHECK(sent<WorkerHello>(driver.pass(1s), 0).size() == 1);
        (void)driver.receive(0, welcome_of(1, {{broker_id(1), endpoint_of(2)}}));
        CHECK(driver.crew.is_connected(session(0)));
        // For good: nothing of it is seen any more.
        CHECK(driver.crew.sessions() == std::vector{session(0)});
        CHECK(sent<WorkerHello>(driver.pass_with_beats(1min, {0}), 0).empty());
        CHECK_FALSE(driver.crew.finished());
    }
    SUBCASE("found out by its id: one that was given stays") {
        CrewDriver driver(2);
        (void)driver.step(CrewTick{});
        (void)driver.receive(0, welcome_of(1, {{broker_id(7), "tcp://alias:50057"}}));
        (void)driver.receive(2, welcome_of(7, members({1, 7})));
        const auto actions = driver.receive(1, welcome_of(7, members({1, 7})));
        CHECK(of_type<Close>(actions, 2).size() == 1);
        CHECK(driver.crew.is_connected(session(1))); // the broker knows the worker by it
        CHECK(
            opened(driver.receive(0, Brokers{{}, {{broker_id(7), "tcp://alias:50057"}}})).empty());
    }
    SUBCASE("found out by its refusal") {
        CrewDriver driver(2);
        (void)driver.step(CrewTick{});
        const Refused refused{
            RefusalCode::conflict, {}, "a newer incarnation of this worker is here"};
        CHECK(count_closed(driver.receive(1, refused)) == 0); // whoever that may be
        (void)driver.receive(0, welcome_of(1));
        const auto actions = driver.receive(1, refused);
        CHECK(of_type<Close>(actions, 1).size() == 1);
        CHECK(driver.crew.is_connected(session(0)));
        CHECK(sent<WorkerHello>(driver.pass_with_beats(1min, {0}), 1).empty());
    }
    SUBCASE("brokers that do not say who they are may be two") {
        CrewDriver driver(2);
        (void)driver.step(CrewTick{});
        (void)driver.receive(0, welcome());
        CHECK(count_closed(driver.receive(1, welcome())) == 0);
    }
}

// ------------------------------------------------------------------------------------ what they
// hear

TEST_CASE("every broker of a farm hears every answer; independent ones those to their own tiles") {
    for (const bool are_one_farm : {true, false}) {
        CAPTURE(are_one_farm);
        Pair driver(are_one_farm);
        const Ticket done = driver.give(0, 5), broken = driver.give(0, 6);
        auto actions = driver.step(0, finished(done));
        auto own = sent<TileRendered>(actions, 0), other = sent<TileRendered>(actions, 1);
        REQUIRE(own.size() == 1);
        CHECK(own[0].rect == PixelRect{0, 0, 16, 16});
        CHECK(other.size() == (are_one_farm ? 1 : 0));
        if (are_one_farm)
            CHECK(encode(other[0]).body == encode(own[0]).body);
        actions = driver.step(0, TileBroken{broken, {ErrorCode::io, "no"}});
        CHECK(sent<TileFailed>(actions, 0).size() == 1);
        CHECK(sent<TileFailed>(actions, 1).size() == (are_one_farm ? 1 : 0));
        CHECK(driver.step(0, finished(done)).empty()); // once
    }
}

TEST_CASE("an independent broker beside a farm hears nothing of it") {
    CrewDriver driver(3);
    (void)driver.step(CrewTick{});
    (void)driver.receive(0, welcome_of(1, members({1, 2}), term(9)));
    (void)driver.receive(1, welcome_of(2, members({1, 2}), term(9)));
    (void)driver.receive(2, welcome_of(3, {}, term(4, 3)));
    const TestScene scene(10);
    RenderTile tile = order(scene, 5);
    tile.term = term(9);
    (void)driver.receive(0, tile);
    CHECK(named(driver.pass(1s), 2).empty());
    const auto actions = driver.receive(0, CancelTile{tile.job, tile.tile, tile.attempt});
    CHECK(sent<TileFailed>(actions, 1).size() == 1);
    CHECK(of_type<Send>(actions, 2).empty());
    for (std::uint32_t of = 0; of < 3; ++of)
        (void)driver.receive(of, Beat{});
    CHECK(sent<WorkerBeat>(driver.pass(1s), 2).at(0).term == term(4, 3));
}

TEST_CASE("what a probe finds is for the broker that asked, as long as its session stands") {
    Pair driver;
    RenderTile probe = order(driver.scene, 5, 2000);
    probe.probe_side = 4;
    const Ticket ticket = of_type<StartTile>(driver.receive(0, probe), 0).at(0).ticket;
    CHECK(named(driver.pass(1s), 1) == Tiles{TileIndex{5}});
    SUBCASE("it stands") {
        const auto actions = driver.step(0, finished(ticket));
        REQUIRE(sent<TileRendered>(actions, 0).size() == 1);
        CHECK(sent<TileRendered>(actions, 0)[0].rect.empty());
        CHECK(sent<TileRendered>(actions, 1).empty());
    }
    SUBCASE("it is lost") {
        CHECK(of_type<StopTile>(driver.lose(0), 0).size() == 1);
        CHECK(of_type<Send>(driver.step(0, finished(ticket)), 1).empty());
    }
}

TEST_CASE("a beat names what was given by any broker of the farm, but counts its own RenderTiles") {
    for (const bool are_one_farm : {true, false}) {
        CAPTURE(are_one_farm);
        Pair driver(are_one_farm);
        const Ticket ticket = driver.give(0, 5);
        (void)driver.give(1, 6);
        (void)driver.give(1, 7);
        driver.now = driver.now + 1s;
        const auto actions =
            driver.step(CrewTick{{{session(0), {{ticket, 42}}}, {session(1), {{ticket, 1}}}}});
        const auto first = sent<WorkerBeat>(actions, 0), second = sent<WorkerBeat>(actions, 1);
        REQUIRE(first.size() == 1);
        REQUIRE(second.size() == 1);
        CHECK(first[0].in_flight.size() == (are_one_farm ? 3 : 1));
        CHECK(second[0].in_flight.size() == (are_one_farm ? 3 : 2));
        CHECK(first[0].tiles_received == 2); // with the first, that brought the scene
        CHECK(second[0].tiles_received == 3);
        CHECK(first[0].in_flight[0].rect == PixelRect{0, 0, 16, 16});
        for (const TileInFlight& tile : second[0].in_flight)
            CHECK(tile.rays == (tile.tile == TileIndex{5} ? 42 : 0)); // however it is told
    }
}

TEST_CASE("whoever says who leads now hears at once what is in hand") {
    Pair driver;
    (void)driver.give(0, 5);
    const auto actions = driver.receive(1, Brokers{term(7, 2), driver.list});
    CHECK(named(actions, 1) == Tiles{TileIndex{5}});
    CHECK(sent<WorkerBeat>(actions, 1).at(0).term == term(7, 2));
    CHECK(sent<WorkerBeat>(actions, 0).empty());
    CHECK(sent<WorkerBeat>(driver.pass(1s), 0).at(0).term == term(7, 2)); // the other hears of it
}

TEST_CASE("one that does not lead any more has its tile back, and hears who does") {
    Pair driver(true, term(5));
    driver.at = term(5);
    (void)driver.give(0, 1);
    (void)driver.receive(1, Brokers{term(6, 2), driver.list});
    RenderTile late = order(driver.scene, 5, 2000);
    late.term = term(5);
    const auto actions = driver.receive(0, late);
    const auto beats = sent<WorkerBeat>(actions, 0);
    REQUIRE(beats.size() == 1);
    CHECK(beats[0].term == term(6, 2));
    CHECK(beats[0].tiles_received == 3); // the tile among them, and not named: so it was lost
    CHECK(named(actions, 0) == Tiles{TileIndex{1}});
    CHECK(of_type<Send>(actions, 0).size() == 1);
    CHECK(of_type<StartTile>(actions, 0).empty());
    // A tile may be the first to tell of a new term.
    driver.at = term(8, 2);
    (void)driver.give(1, 6);
    late.attempt = AttemptNumber{2001};
    late.term = term(7);
    CHECK(sent<WorkerBeat>(driver.receive(0, late), 0).at(0).term == term(8, 2));
}

TEST_CASE("a broker that stands alone may begin again with a lower term") {
    const TestScene scene(10);
    const auto is_taken = [&](CrewDriver& driver, std::uint64_t counter, std::uint8_t leader) {
        RenderTile tile = order(scene, 5);
        tile.term = term(counter, leader);
        return sent<NeedChunk>(driver.receive(0, tile), 0).size() == 1;
    };
    SUBCASE("whose clock went back") {
        CrewDriver driver;
        (void)driver.step(CrewTick{});
        (void)driver.receive(0, welcome_of(1, {}, term(100, 1)));
        (void)driver.receive(0, Refused{RefusalCode::unknown_peer, {}, ""});
        (void)driver.pass(1s);
        (void)driver.receive(0, welcome_of(2, {}, term(50, 2)));
        CHECK(is_taken(driver, 50, 2));
        CHECK(sent<WorkerBeat>(driver.pass(1s), 0).at(0).term == term(50, 2));
    }
    SUBCASE("beside another one that has nothing to do with it") {
        CrewDriver driver(2);
        (void)driver.step(CrewTick{});
        (void)driver.receive(0, welcome_of(1, {}, term(50, 1)));
        (void)driver.receive(1, welcome_of(2, {}, term(100, 2)));
        CHECK(is_taken(driver, 50, 1));
    }
    SUBCASE("that had peers, and now has none") {
        Pair driver(true, term(100));
        (void)driver.lose(0);
        (void)driver.pass(1s);
        (void)driver.receive(0, welcome_of(3, {}, term(50, 3)));
        CHECK(is_taken(driver, 50, 3));
        CHECK(sent<WorkerBeat>(driver.pass(1s), 0).at(0).term == term(50, 3));
    }
}

TEST_CASE("brokers that do not hear each other any more still stand for each other") {
    Pair driver(true, term(5));
    (void)driver.receive(0, Brokers{term(5), members({1})});
    (void)driver.receive(1, Brokers{term(6, 2), members({2})});
    RenderTile late = order(driver.scene, 5, 2000);
    late.term = term(5);
    CHECK(sent<WorkerBeat>(driver.receive(0, late), 0).at(0).term == term(6, 2));
    driver.at = term(6, 2);
    CHECK(sent<TileRendered>(driver.step(1, finished(driver.give(1, 6))), 0).size() == 1);
}

TEST_CASE("a broker of another farm that has come to an endpoint is no ally") {
    Pair driver;
    (void)driver.lose(0);
    (void)driver.pass(1s);
    (void)driver.receive(0, welcome_of(8, members({8, 9})));
    CHECK(sent<TileRendered>(driver.step(1, finished(driver.give(1, 6))), 0).empty());
}

// ----------------------------------------------------------------------------- brokers that are
// lost

TEST_CASE("tiles of a lost broker go on while another one of the farm is there") {
    Pair driver;
    const Ticket first = driver.give(0, 5), second = driver.give(0, 6);
    auto actions = driver.lose(0);
    CHECK(of_type<StopTile>(actions, 0).empty());
    CHECK(named(driver.receive(1, Brokers{term(2, 2), driver.list}), 1) ==
          Tiles{TileIndex{5}, TileIndex{6}});
    actions = driver.step(0, finished(first));
    CHECK(sent<TileRendered>(actions, 1).size() == 1);
    CHECK(of_type<Send>(actions, 0).empty()); // it is not there
    CHECK(sent<WorkerHello>(driver.pass(1s), 0).size() == 1);
    SUBCASE("the same comes back") {
        (void)driver.receive(0, welcome_of(1, driver.list));
    }
    SUBCASE("it comes back as another one, that knows nobody yet") {
        (void)driver.receive(0, welcome_of(3, members({3})));
    }
    CHECK(named(driver.receive(0, Brokers{term(2, 2), driver.list}), 0) == Tiles{TileIndex{6}});
    actions = driver.step(0, finished(second));
    CHECK(sent<TileRendered>(actions, 0).size() == 1);
    CHECK(sent<TileRendered>(actions, 1).size() == 1);
}

TEST_CASE("a broker that is silent is lost as one that forgets") {
    Pair driver;
    const Ticket ticket = driver.give(0, 5);
    (void)driver.pass_with_beats(4s, {1});
    CHECK_FALSE(driver.crew.is_connected(session(0)));
    CHECK(driver.crew.is_connected(session(1)));
    CHECK(sent<TileRendered>(driver.step(0, finished(ticket)), 1).size() == 1);
}

TEST_CASE("of a lost broker's tiles those go whose scene was still to come from it") {
    Pair driver;
    const TestScene coming(10, 'c'), compiling(10, 'd');
    (void)driver.give(0, 5);
    (void)driver.receive(0, order(coming, 6, 2000));
    (void)driver.receive(0, order(compiling, 7, 2001));
    (void)driver.receive(0, compiling.chunk(0));
    const auto actions = driver.lose(0);
    CHECK(sent<TileFailed>(actions, 1).empty()); // without a word
    CHECK(named(driver.receive(1, Brokers{{}, driver.list}), 1) ==
          Tiles{TileIndex{5}, TileIndex{7}});
    CHECK(of_type<StartTile>(driver.step(0, SceneCompiled{compiling.hash}), 0).size() == 1);
}

TEST_CASE("when the last broker of a farm is lost, all of its tiles go") {
    Pair driver;
    (void)driver.give(0, 5);
    (void)driver.give(1, 6);
    CHECK(of_type<StopTile>(driver.lose(0), 0).empty());
    const auto actions = driver.lose(1);
    CHECK(of_type<StopTile>(actions, 0).size() == 1);
    CHECK(of_type<StopTile>(actions, 1).size() == 1);
    Pair independent(false);
    (void)independent.give(0, 5);
    CHECK(of_type<StopTile>(independent.lose(0), 0).size() == 1);
}

TEST_CASE("any broker of the farm takes a tile back, wherever it is, and all hear of it") {
    Pair driver;
    const Ticket ticket = driver.give(0, 5);
    const CancelTile cancel{job_id(1), TileIndex{5}, AttemptNumber{driver.attempts}};
    SUBCASE("whose giver is there") {
        const auto actions = driver.receive(1, cancel);
        CHECK(of_type<StopTile>(actions, 0).at(0).ticket == ticket);
        CHECK(sent<TileFailed>(actions, 0).at(0).code == FailureCode::cancelled);
        CHECK(sent<TileFailed>(actions, 1).at(0).code == FailureCode::cancelled);
    }
    SUBCASE("whose giver is lost, and may say what it likes") {
        (void)driver.lose(0);
        CHECK(of_type<StopTile>(driver.receive(0, cancel), 0).empty());
        const auto actions = driver.receive(1, cancel);
        CHECK(of_type<StopTile>(actions, 0).size() == 1);
        CHECK(of_type<Send>(actions, 0).empty());
        CHECK(sent<TileFailed>(actions, 1).size() == 1);
    }
    Pair independent(false);
    (void)independent.give(0, 5);
    CHECK(of_type<StopTile>(independent.receive(1, cancel), 0).empty());
}

TEST_CASE("while one broker takes over from another, tiles come up to twice the credit") {
    for (const bool are_one_farm : {true, false}) {
        CAPTURE(are_one_farm);
        Pair driver(are_one_farm);
        for (std::uint32_t tile = 0; tile < 4; ++tile)
            (void)driver.give(0, tile);
        for (std::uint32_t tile = 4; tile < 8; ++tile)
            (void)driver.give(1, tile);
        const auto actions = driver.receive(1, order(driver.scene, 8, 2000));
        CHECK(sent<TileFailed>(actions, 0).empty()); // it never was in hand
        if (are_one_farm) { // the broker hears what is, and that this one is not
            CHECK(sent<TileFailed>(actions, 1).empty());
            CHECK(sent<WorkerBeat>(actions, 1).at(0).in_flight.size() == 8);
        } else {
            CHECK(sent<TileFailed>(actions, 1).at(0).reason == "beyond this worker's credit");
        }
    }
}

TEST_CASE("a tile that two brokers give under one name is drawn once") {
    Pair driver;
    const Ticket ticket = driver.give(0, 5);
    RenderTile again = order(driver.scene, 5, driver.attempts);
    SUBCASE("for both") {
        const auto actions = driver.receive(1, again);
        CHECK(of_type<StartTile>(actions, 1).empty());
        CHECK(of_type<Send>(actions, 1).empty());
        const auto later = driver.pass(1s);
        CHECK(named(later, 1) == Tiles{TileIndex{5}});
        CHECK(sent<WorkerBeat>(later, 1).at(0).tiles_received == 2);
        CHECK(sent<TileRendered>(driver.step(0, finished(ticket)), 1).size() == 1);
    }
    SUBCASE("unless they mean two tiles") {
        again.rect.x = 16;
        const auto actions = driver.receive(1, again);
        CHECK(sent<TileFailed>(actions, 1).at(0).code == FailureCode::machine);
        CHECK(of_type<Send>(actions, 0).empty());
    }
}

// ---------------------------------------------------------------------------------------- the end

TEST_CASE("a worker that leaves finishes what any broker of the farm waits for") {
    Pair driver;
    const Ticket lost = driver.give(0, 5);
    (void)driver.lose(0);
    const Ticket own = driver.give(1, 6);
    auto actions = driver.step(Drain{});
    CHECK(sent<WorkerBeat>(actions, 1).at(0).credit == 0);
    (void)driver.receive(1, Beat{});
    SUBCASE("its own first") {
        actions = driver.step(1, finished(own));
        CHECK(sent<TileRendered>(actions, 1).size() == 1);
        CHECK(sent<Goodbye>(actions, 1).empty());
        actions = driver.step(0, finished(lost));
    }
    SUBCASE("the lost one's first") {
        actions = driver.step(0, finished(lost));
        CHECK(of_type<Close>(actions, 0).size() == 1);
        CHECK(sent<Goodbye>(actions, 1).empty());
        actions = driver.step(1, finished(own));
    }
    SUBCASE("but its last broker is lost as well") {
        actions = driver.lose(1);
        CHECK(of_type<StopTile>(actions, 0).size() == 1);
        CHECK(of_type<StopTile>(actions, 1).size() == 1);
        CHECK(driver.crew.finished() == FinishReason::drained);
        return;
    }
    CHECK(sent<TileRendered>(actions, 1).size() == 1);
    CHECK(sent<Goodbye>(actions, 1).size() == 1);
    CHECK(driver.crew.finished() == FinishReason::drained);
    CHECK(driver.crew.next_deadline() == Instant::never());
}

TEST_CASE("both brokers hear Goodbye, when nothing is left for either") {
    Pair driver;
    const Ticket ticket = driver.give(0, 5);
    (void)driver.step(Drain{});
    (void)driver.receive(0, Beat{});
    CHECK(sent<Goodbye>(driver.receive(1, Beat{}), 1).empty());
    const auto actions = driver.step(0, finished(ticket));
    CHECK(sent<Goodbye>(actions, 0).size() == 1);
    CHECK(sent<Goodbye>(actions, 1).size() == 1);
    const auto at = [&](std::uint32_t of, auto is_it) {
        return std::ranges::find_if(actions, [&](const CrewAction& action) {
            const auto* send = std::get_if<Send>(&action.deed);
            return send && action.session == session(of) && is_it(send->message);
        });
    };
    const auto is_answer = [](const Message& m) { return std::holds_alternative<TileRendered>(m); };
    const auto is_goodbye = [](const Message& m) { return std::holds_alternative<Goodbye>(m); };
    CHECK(at(1, is_answer) < at(1, is_goodbye));
}

TEST_CASE("nobody is given back a tile before all have heard that no other is taken") {
    Pair driver;
    (void)driver.give(0, 5);
    (void)driver.give(1, 6);
    const auto actions = driver.step(StopNow{});
    for (std::uint32_t of = 0; of < 2; ++of) {
        const auto sends = of_type<Send>(actions, of);
        REQUIRE(sends.size() == 3);
        CHECK(std::get<WorkerBeat>(sends[0].message).credit == 0);
        CHECK(sent<TileFailed>(actions, of).size() == 2);
    }
    (void)driver.receive(0, Beat{});
    CHECK_FALSE(driver.crew.finished());
    (void)driver.receive(1, Beat{});
    CHECK(driver.crew.finished() == FinishReason::stopped);
}

TEST_CASE("a worker that is dismissed by all brokers ends, and not before") {
    Pair driver;
    (void)driver.give(0, 5);
    auto actions = driver.receive(0, Dismissed{"go"});
    CHECK(of_type<StopTile>(actions, 0).size() == 1);
    CHECK(of_type<Close>(actions, 0).size() == 1);
    CHECK_FALSE(driver.crew.finished());
    CHECK(opened(driver.receive(1, Brokers{{}, driver.list})).empty()); // it said so, and is there
    (void)driver.receive(1, Dismissed{"go"});
    CHECK(driver.crew.finished() == FinishReason::dismissed);
}

TEST_CASE("a worker does not wait for brokers that it was only told of") {
    CrewDriver driver;
    (void)driver.step(CrewTick{});
    (void)driver.receive(0, welcome_of(1, members({1, 2})));
    SUBCASE("that are not there") {
        const auto actions = driver.receive(0, Dismissed{"go"});
        CHECK(of_type<Close>(actions, 1).size() == 1);
        CHECK(driver.crew.finished() == FinishReason::dismissed);
    }
    SUBCASE("but serves those that are") {
        (void)driver.receive(1, welcome_of(2, members({1, 2})));
        (void)driver.receive(0, Dismissed{"go"});
        CHECK_FALSE(driver.crew.finished());
        (void)driver.receive(1, Refused{RefusalCode::unknown_peer, {}, ""});
        CHECK(driver.crew.finished() == FinishReason::dismissed);
    }
}

TEST_CASE("a broker that comes back with another version leaves its tiles to the others") {
    Pair driver;
    const Ticket ticket = driver.give(0, 5);
    (void)driver.lose(0);
    (void)driver.pass(1s);
    auto actions = driver.step(0, Undecodable{{ErrorCode::version_mismatch, "version 9"}});
    CHECK(of_type<StopTile>(actions, 0).empty());
    actions = driver.step(0, finished(ticket));
    CHECK(sent<TileRendered>(actions, 1).size() == 1);
    CHECK(of_type<Close>(actions, 0).size() == 1);
    CHECK_FALSE(driver.crew.finished());
}

// ------------------------------------------------------------------------------- what threads may
// hold

TEST_CASE("a session that is over leaves no scene behind, and its number may be used again") {
    CrewDriver driver;
    (void)driver.step(CrewTick{});
    (void)driver.receive(0, welcome_of(1, members({1, 2})));
    (void)driver.receive(1, welcome_of(2, members({1, 2})));
    const TestScene here(10, 'h'), coming(10, 'c');
    std::uint32_t attempts = 0;
    for (const TestScene* scene : {&here, &coming}) {
        (void)driver.receive(1, order(*scene, 5, ++attempts));
        (void)driver.receive(1, scene->chunk(0));
    }
    auto actions = driver.step(1, SceneCompiled{here.hash});
    const Ticket old = of_type<StartTile>(actions, 1).at(0).ticket;
    actions = driver.receive(1, Dismissed{"go"});
    REQUIRE(of_type<ForgetScene>(actions, 1).size() == 1);
    CHECK(of_type<ForgetScene>(actions, 1)[0].scene == here.hash);
    // As long as a scene is being compiled for it, nobody else has the number.
    CHECK(opened(driver.receive(0, Brokers{{}, members({1, 3})})).size() == 1);
    CHECK(driver.crew.sessions() == std::vector{session(0), session(2)});
    actions = driver.step(1, SceneCompiled{coming.hash});
    REQUIRE(of_type<ForgetScene>(actions, 1).size() == 1);
    CHECK(of_type<ForgetScene>(actions, 1)[0].scene == coming.hash);
    CHECK(driver.step(1, SceneCompiled{coming.hash}).empty());
    CHECK(opened(driver.receive(0, Brokers{{}, members({1, 3, 4})})).size() == 1);
    CHECK(driver.crew.sessions().size() == 3);
    REQUIRE(driver.crew.sessions()[1] == session(1));
    (void)driver.receive(1, welcome_of(4, members({1, 3, 4})));
    (void)driver.receive(1, order(here, 6, 1));
    (void)driver.receive(1, here.chunk(0));
    CHECK(of_type<StartTile>(driver.step(1, SceneCompiled{here.hash}), 1).at(0).ticket > old);
    CHECK(driver.step(1, finished(old)).empty()); // of the session before
}

TEST_CASE("the sessions of a worker never use a ticket twice") {
    Pair driver;
    std::set<Ticket> tickets;
    for (std::uint32_t tile = 0; tile < 4; ++tile)
        tickets.insert(driver.give(tile % 2, tile));
    CHECK(tickets.size() == 4);
}

// ------------------------------------------------------------------------------ brokers that are
// found

TEST_CASE("a worker serves the brokers that are found, and looks on when it has none") {
    CrewDriver driver(0);
    CHECK(driver.crew.is_alone());
    CHECK(driver.crew.next_deadline() == Instant::never());
    CHECK_FALSE(driver.crew.finished());
    const auto actions =
        driver.step(BrokersFound{"auto", {endpoint_of(1), endpoint_of(2), endpoint_of(1)}});
    CHECK(opened(actions) == std::vector{endpoint_of(1), endpoint_of(2)});
    CHECK(sent<WorkerHello>(actions, 0).size() == 1);
    CHECK(sent<WorkerHello>(actions, 1).size() == 1);
    CHECK(of_type<Log>(actions, 1).at(0).text == "found by auto");
    CHECK(driver.crew.is_alone()); // nobody has answered yet
    (void)driver.receive(0, welcome_of(1));
    CHECK_FALSE(driver.crew.is_alone());
    // Known ones are not opened again; another source may have others.
    CHECK(opened(driver.step(BrokersFound{"auto", {endpoint_of(1), endpoint_of(2)}})).empty());
    CHECK(opened(driver.step(BrokersFound{"srv:x", {endpoint_of(2), endpoint_of(3)}})) ==
          std::vector{endpoint_of(3)});
}

TEST_CASE("a broker that is not found any more is let go of when it is not there") {
    CrewDriver driver(0);
    (void)driver.step(BrokersFound{"auto", {endpoint_of(1), endpoint_of(2)}});
    (void)driver.receive(0, welcome_of(1));
    auto actions = driver.step(BrokersFound{"auto", {}});
    CHECK(of_type<Close>(actions, 1).size() == 1); // it has never answered
    CHECK(count_closed(actions) == 1); // the other one may have stopped to announce itself
    actions.clear();
    while (!driver.crew.is_alone()) // until it is silent for too long
        actions = driver.pass(1s);
    CHECK(of_type<Close>(actions, 0).size() == 1);
    CHECK(driver.crew.sessions().empty());
    CHECK_FALSE(driver.crew.finished());
    CHECK(opened(driver.step(BrokersFound{"auto", {endpoint_of(3)}})) ==
          std::vector{endpoint_of(3)});
}

TEST_CASE(
    "of two endpoints that lead to one broker one is served, and the other tried when alone") {
    CrewDriver driver(0);
    (void)driver.step(BrokersFound{"auto", {endpoint_of(1), endpoint_of(2)}});
    (void)driver.receive(0, welcome_of(1));
    const auto actions = driver.receive(1, welcome_of(1));
    CHECK(of_type<Close>(actions, 1).size() == 1);
    CHECK(opened(driver.step(BrokersFound{"auto", {endpoint_of(1), endpoint_of(2)}})).empty());
    CHECK(driver.crew.is_alone()); // the other one is greeted anew, in vain
    (void)driver.pass(20s);
    CHECK(opened(driver.step(BrokersFound{"auto", {endpoint_of(1), endpoint_of(2)}})) ==
          std::vector{endpoint_of(2)});
}

TEST_CASE("a broker that is found tells of others, as any does") {
    CrewDriver driver(0);
    (void)driver.step(BrokersFound{"auto", {endpoint_of(1)}});
    CHECK(opened(driver.receive(0, welcome_of(1, members({1, 2})))) == std::vector{endpoint_of(2)});
    // One that is announced as well is not served twice, and stays when it is told of no more.
    CHECK(opened(driver.step(BrokersFound{"auto", {endpoint_of(1), endpoint_of(2)}})).empty());
}

TEST_CASE("endless brokers that are found take no more sessions than a limit says") {
    CrewDriver driver(0);
    for (std::uint8_t round = 0; round < 5; ++round) {
        BrokersFound found{"auto", {}};
        for (std::uint8_t i = 0; i < 40; ++i)
            found.endpoints.push_back(endpoint_of(static_cast<std::uint8_t>(40 * round + i)));
        (void)driver.step(found);
        CHECK(driver.crew.sessions().size() == brokers_found_max);
    }
}

TEST_CASE("a worker that has found a broker of another version looks for others") {
    CrewDriver driver(0);
    (void)driver.step(BrokersFound{"auto", {endpoint_of(1)}});
    const auto actions =
        driver.receive(0, Refused{RefusalCode::version_mismatch, {}, "it is another one"});
    CHECK(of_type<Close>(actions, 0).size() == 1);
    CHECK_FALSE(driver.crew.finished());
    CHECK(opened(driver.step(BrokersFound{"auto", {endpoint_of(1), endpoint_of(2)}})) ==
          std::vector{endpoint_of(2)});
    (void)driver.pass(20s); // it may have been replaced
    CHECK(opened(driver.step(BrokersFound{"auto", {endpoint_of(1), endpoint_of(2)}})) ==
          std::vector{endpoint_of(1)});
}

TEST_CASE("a worker that looks for brokers leaves when it is told to, by whomever") {
    {
        CrewDriver driver(0);
        (void)driver.step(Drain{});
        CHECK(driver.crew.finished() == FinishReason::drained);
    }
    {
        CrewDriver driver(0);
        (void)driver.step(StopNow{});
        CHECK(driver.crew.finished() == FinishReason::stopped);
    }
    {
        CrewDriver driver(0);
        (void)driver.step(BrokersFound{"auto", {endpoint_of(1), endpoint_of(2)}}); // one is silent
        (void)driver.step(Drain{});
        CHECK(driver.crew.finished() == FinishReason::drained);
        CHECK(opened(driver.step(BrokersFound{"auto", {endpoint_of(3)}})).empty());
    }
    {
        CrewDriver driver(0);
        (void)driver.step(BrokersFound{"auto", {endpoint_of(1)}});
        (void)driver.receive(0, welcome_of(1));
        (void)driver.receive(0, Dismissed{});
        CHECK(driver.crew.finished() == FinishReason::dismissed);
    }
}
