// Several brokers that stand for each other: whom each of them knows, and who deals out tiles.
#include "tests/broker/fleet.hpp"

#include <chrono>
#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::broker;
using namespace fraja::protocol;
using namespace std::chrono_literals;

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

TEST_CASE("of a peer that never was, and of one that is the broker itself, the log says so once") {
    Fleet fleet(2);
    fleet.pass(4s);
    const auto count = [&](std::string_view kind) {
        return std::ranges::count(fleet.nodes[0].logs, kind, &Log::kind);
    };
    CHECK(count("peer_missed") == 0);
    fleet.kill(1);
    fleet.kill(0);
    fleet.start(0); // whose peer is not there
    fleet.pass(9s);
    CHECK(count("peer_missed") == 0);
    fleet.pass(60s);
    CHECK(count("peer_missed") == 1);
    CHECK(std::ranges::any_of(fleet.nodes[0].logs, [](const Log& line) {
        return line.kind == "synced" && line.text.starts_with("has heard no other broker");
    }));
    fleet.event(0, BrokerSaid{"tcp://b1:50057", BrokerHello{.broker = fleet.nodes[0].id,
                                                            .started_at = {},
                                                            .endpoint = {},
                                                            .program_version = {}}});
    CHECK(count("peer_is_self") == 1);
    Fleet was(2);
    was.pass(4s);
    was.kill(0);
    was.pass(was.limits.absence_max + 60s);
    CHECK_FALSE(was.has_logged(1, "peer_missed")); // it was there
}

TEST_CASE("a broker that cannot be reached where it says it is counts once") {
    const auto check_counts = [](Fleet& fleet, std::size_t i) {
        fleet.event(i, TopicSubscribed{std::string(farm_topic)});
        fleet.pass(4s);
        const auto told = std::ranges::find_if(fleet.nodes[i].stream, [](const Publish& p) {
            return std::holds_alternative<FarmState>(p.message);
        });
        REQUIRE(told != fleet.nodes[i].stream.end());
        CHECK(std::get<FarmState>(told->message).brokers.size() == 2);
        CHECK(fleet.at(i).figures().brokers_here == 2);
        CHECK(fleet.at(i).figures().brokers_gone == 0);
        const JobId job = fleet.submit(i, "c", Farm::picture(1, 3));
        CHECK(fleet.state(i, job)->copies == 1);
        CHECK(fleet.state(i, job)->copies_wanted == 1);
        fleet.kill(1 - i);
        fleet.pass(4s);
        CHECK(fleet.state(i, job)->copies == 0);
        CHECK(fleet.state(i, job)->copies_wanted == 1);
    };
    const std::string nowhere = "tcp://nowhere:50057";
    SUBCASE("and is reached where it was configured, which was answered later") {
        Fleet fleet(2);
        fleet.kill(0);
        fleet.kill(1);
        fleet.advertised[0] = nowhere;
        fleet.start(0);
        fleet.nodes[1].cut.insert(0); // it hears, and is not heard yet
        fleet.start(1);
        fleet.pass(2s);
        REQUIRE(fleet.nodes[1].dialled.contains(nowhere));
        fleet.heal();
        fleet.pass(4s);
        CHECK_FALSE(fleet.nodes[1].dialled.contains(nowhere));
        check_counts(fleet, 1);
    }
    SUBCASE("and is reached by its own connection alone") {
        Fleet fleet(1);
        fleet.advertised[1] = nowhere;
        fleet.start(1);
        fleet.pass(4s);
        CHECK(fleet.nodes[0].dialled.contains(nowhere));
        check_counts(fleet, 0);
    }
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
        std::vector<std::string> led_by;
        for (const Log& line : fleet.nodes[count - 1].logs)
            if (line.kind == "led_by")
                led_by.push_back(line.text.substr(0, line.text.find(" (term")));
        REQUIRE(led_by.size() == count - 1);
        for (std::size_t i = 0; i < led_by.size(); ++i)
            CHECK(led_by[i] == "broker tcp://b" + std::to_string(i) + ":50057 leads");
    }
}

TEST_CASE("a tile that was begun under another leader took as long as its worker says") {
    Fleet fleet(2);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 1);
    const SubmitJob picture = Farm::picture(1, 1);
    (void)fleet.submit(0, "c", picture);
    fleet.event(1, TopicSubscribed{job_topic(picture.job)});
    fleet.pass(5s);
    fleet.kill(0);
    fleet.pass(2500ms);
    REQUIRE(fleet.leaders() == std::vector<std::size_t>{1});
    REQUIRE(fleet.state(1, picture.job)->in_flight_count == 1);
    const auto told = [&]() -> const TileDone* {
        for (const Publish& p : fleet.nodes[1].stream)
            if (const auto* tile = std::get_if<TileDone>(&p.message))
                return tile;
        return nullptr;
    };
    SUBCASE("") {
        fleet.drawing_time = 7400ms;
        fleet.render_one("w");
        REQUIRE(told());
        CHECK(told()->elapsed == 7400ms);
        CHECK(fleet.at(1).counters().render_time == 7400ms);
    }
    SUBCASE("but no longer than it can have had it") {
        fleet.drawing_time = 1h;
        fleet.render_one("w");
        REQUIRE(told());
        CHECK(told()->elapsed <= 7500ms + fleet.limits.heartbeat);
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

TEST_CASE("whoever says to be another broker each time takes nobody's place") {
    Dispatcher dispatcher(Dispatcher::Identity{.broker = id_of<BrokerId>(1),
                                               .epoch = 1,
                                               .stream = "tcp://a:50058",
                                               .endpoint = "tcp://a:50057",
                                               .peers = {"tcp://b:50057"}},
                          {});
    std::vector<Action> actions;
    dispatcher.step(Instant{}, Tick{}, actions);
    BrokerHello hello;
    for (std::uint8_t id = 2; id < 200; ++id) {
        hello.broker = id_of<BrokerId>(id);
        dispatcher.step(Instant{}, BrokerSaid{"tcp://b:50057", hello}, actions);
        CHECK(dispatcher.membership().peers().size() == 1); // where it was is the next one now
    }
    for (std::uint8_t id = 2; id < 200; ++id) {
        hello.broker = id_of<BrokerId>(id);
        dispatcher.step(Instant{}, PeerSaid{"stranger", hello}, actions);
        CHECK(dispatcher.membership().peers().size() < brokers_max);
    }
    hello.broker = id_of<BrokerId>(200);
    dispatcher.step(Instant{}, BrokerSaid{"tcp://b:50057", hello}, actions);
    CHECK(dispatcher.membership().peers().size() < brokers_max);
}

TEST_CASE("brokers that do not say where they are leave nothing behind when they start anew") {
    Fleet fleet(2);
    fleet.advertised = {{0, ""}, {1, ""}}; // as when bound to all addresses
    fleet.kill(0);
    fleet.start(0);
    fleet.pass(4s);
    for (int i = 0; i < 20; ++i) {
        fleet.kill(1);
        fleet.start(1);
        fleet.pass(3s);
        CHECK(fleet.at(0).membership().peers().size() == 1);
        CHECK(fleet.at(1).membership().peers().size() == 1);
        CHECK(fleet.leaders() == std::vector<std::size_t>{0});
    }
    for (std::size_t i = 0; i < 2; ++i)
        for (const Log& line : fleet.nodes[i].logs)
            CHECK(line.text.find("broker  ") == std::string::npos);
}

TEST_CASE("limits: brokers_max: those that are gone give way, and the farm goes on") {
    Fleet fleet(2);
    fleet.advertised = {{1, ""}}; // and broker 0 has nothing to dial
    for (std::size_t i = 0; i < 2 * brokers_max; ++i) {
        fleet.kill(1);
        fleet.start(1);
        fleet.pass(3s);
        REQUIRE(fleet.at(0).membership().peers().size() < brokers_max);
        REQUIRE(fleet.leaders() == std::vector<std::size_t>{0});
        REQUIRE(fleet.at(1).membership().is_synced());
    }
}

TEST_CASE("that two brokers say to be at one place is said") {
    Fleet fleet(3);
    for (std::size_t i = 0; i < 3; ++i)
        fleet.advertised[i] = "tcp://farm:50057";
    for (std::size_t i = 0; i < 3; ++i) {
        fleet.kill(i);
        fleet.start(i);
    }
    fleet.pass(5s);
    bool is_said = false;
    for (std::size_t i = 0; i < 3; ++i)
        is_said = is_said || fleet.has_logged(i, "one_place_twice");
    CHECK(is_said);
}

TEST_CASE("one worker that lies about the leader holds up no takeover") {
    Fleet fleet(2);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 1);
    fleet.worker_arrives("v", 2, 1);
    fleet.worker_arrives("liar", 3, 1, {0});
    fleet.workers.erase("liar"); // which says what it likes
    const Term term = fleet.at(1).membership().term();
    const BrokerId dead = fleet.nodes[0].id;
    WorkerBeat beat{.credit = 1, .in_flight = {}, .tiles_received = 0, .term = term};
    std::uint64_t step = 0;
    SUBCASE("who says to hear it") {
        beat.leader_silence = 0s;
    }
    SUBCASE("who tells of ever newer terms") {
        beat.term.leader = dead;
        step = 70'000;
    }
    SUBCASE("who tells of a last one") {
        beat.term = {UINT64_MAX / 2 - 1, dead};
    }
    REQUIRE(fleet.leaders() == std::vector<std::size_t>{0});
    fleet.kill(0);
    for (int i = 0; i < 40; ++i) {
        fleet.pass(100ms);
        beat.term.counter += step;
        fleet.say(1, "liar", beat);
    }
    CHECK(fleet.leaders() == std::vector<std::size_t>{1});
    CHECK(fleet.at(1).membership().term().counter < UINT64_MAX / 4);
}

TEST_CASE("a broker that serves another one has no company") {
    Dispatcher dispatcher(
        Dispatcher::Identity{
            .broker = id_of<BrokerId>(1), .epoch = 1, .stream = "tcp://a:50058", .is_branch = true},
        {});
    std::vector<Action> actions;
    BrokerHello hello;
    hello.broker = id_of<BrokerId>(2);
    hello.endpoint = "tcp://b:50057";
    dispatcher.step(Instant{}, PeerSaid{"b", hello}, actions);
    CHECK(dispatcher.membership().peers().size() == 0);
    const auto refused = std::ranges::find_if(actions, [](const Action& action) {
        const auto* send = std::get_if<Send>(&action);
        return send && std::holds_alternative<Refused>(send->message);
    });
    REQUIRE(refused != actions.end());
    CHECK(std::get<Refused>(std::get<Send>(*refused).message).code == RefusalCode::not_allowed);
    CHECK(std::ranges::none_of(
        actions, [](const Action& action) { return std::holds_alternative<Dial>(action); }));
}

TEST_CASE("two that only others hear both do not take turns") {
    const auto terms_begun = [](const Fleet& fleet) {
        std::ptrdiff_t count = 0;
        for (const Fleet::Node& node : fleet.nodes)
            count += std::ranges::count(node.logs, "leads", &Log::kind);
        return count;
    };
    for (const std::size_t brokers : {2u, 3u, 4u})
        for (const bool has_workers : {true, false}) {
            if (brokers == 2 && !has_workers)
                continue; // then nobody hears both
            CAPTURE(brokers);
            CAPTURE(has_workers);
            Fleet fleet(brokers);
            fleet.pass(4s);
            if (has_workers)
                fleet.worker_arrives("w", 1, 2);
            fleet.pass(4s);
            REQUIRE(fleet.leaders() == std::vector<std::size_t>{0});
            fleet.cut(0, 1);
            fleet.pass(60s);
            REQUIRE(fleet.leaders().size() == 1);
            CHECK(terms_begun(fleet) <= (brokers == 2 ? 2 : 1)); // beats of workers are late
            const std::size_t leader = fleet.leaders()[0];
            fleet.kill(leader);
            fleet.pass(6s);
            REQUIRE(fleet.leaders().size() == 1);
            CHECK(terms_begun(fleet) <= (brokers == 2 ? 3 : 2));
        }
}

TEST_CASE("a checked job ends while two brokers hear each other through others alone") {
    Fleet fleet(3);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 2);
    fleet.worker_arrives("v", 2, 2);
    fleet.cut(0, 1);
    fleet.pass(4s);
    const SubmitJob picture = Farm::checked(1, 60);
    const JobId job = fleet.submit(2, "c", picture);
    fleet.pass(3s);
    for (int i = 0; i < 150; ++i) { // a second for each tile and its check
        fleet.render_one("w");
        fleet.render_one("v");
        fleet.pass(500ms);
    }
    CHECK(fleet.state(2, job)->phase == JobPhase::done);
    CHECK(fleet.state(fleet.leaders().at(0), job)->phase == JobPhase::done);
    CHECK(fleet.rendered == 120);
}

TEST_CASE("a broker that no worker reaches does not lead before one that they reach") {
    Fleet fleet(3);
    fleet.pass(4s);
    CHECK(fleet.leaders() == std::vector<std::size_t>{0});
    fleet.worker_arrives("w", 1, 2, {0});
    const JobId job = fleet.submit(0, "c", Farm::picture(1, 6));
    fleet.pass(4s);
    CHECK(fleet.leaders() == std::vector<std::size_t>{0}); // it may come
    fleet.pass(5s);
    CHECK(fleet.leaders() == std::vector<std::size_t>{1});
    CHECK(std::ranges::any_of(fleet.nodes[1].logs, [](const Log& line) {
        return line.kind == "leads" &&
               line.text.find("no worker reaches tcp://b0:50057") != std::string::npos;
    }));
    fleet.render_all("w");
    fleet.pass(3s);
    CHECK(fleet.state(0, job)->phase == JobPhase::done); // it has the tiles from the others
    // It is the first again when it has had some for a while.
    fleet.workers.at("w").cut.clear();
    fleet.greet(0, "w");
    fleet.pass(4s);
    CHECK(fleet.leaders() == std::vector<std::size_t>{1});
    fleet.pass(5s);
    CHECK(fleet.leaders() == std::vector<std::size_t>{0});
    // Where nobody has any, all is as it was.
    fleet.workers.clear();
    fleet.pass(30s);
    CHECK(fleet.leaders() == std::vector<std::size_t>{0});
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
