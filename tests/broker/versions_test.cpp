// Peers of the version before: what they say, and what is said to them.
#include "tests/broker/farm.hpp"

#include <chrono>

using namespace fraja;
using namespace fraja::broker;
using namespace fraja::protocol;
using namespace std::chrono_literals;

namespace {

/// A Farm that also knows in which version everything is said.
struct MixedFarm : Farm {
    explicit MixedFarm(std::vector<std::string> peers = {}) {
        if (!peers.empty())
            dispatcher = Dispatcher({.broker = id_of<BrokerId>(99),
                                     .epoch = 7,
                                     .stream = "tcp://127.0.0.1:50058",
                                     .peers = std::move(peers)},
                                    limits);
        on_action = [this](const Action& action) {
            if (const auto* send = std::get_if<Send>(&action))
                versions[send->peer] = send->version;
            if (const auto* wish = std::get_if<SendStored>(&action))
                versions[wish->peer] = wish->version;
        };
    }
    void say_in(Version version, const PeerId& peer, Message message) {
        event(PeerSaid{peer, std::move(message), {}, version});
    }
    void worker_of(Version version, const PeerId& peer, std::uint8_t id) {
        say_in(version, peer,
               WorkerHello{.worker = id_of<WorkerId>(id),
                           .incarnation = 1,
                           .worker_name = peer,
                           .threads = 1,
                           .credit = 2,
                           .tags = {},
                           .program_version = "test"});
    }

    std::map<PeerId, Version> versions; ///< of what each has heard last
};

constexpr Version older = oldest_version_spoken;

} // namespace

TEST_CASE("each peer is spoken to in the version of its hello") {
    MixedFarm farm;
    farm.worker_of(older, "old", 1);
    farm.worker_of(version, "new", 2);
    CHECK(farm.versions["old"] == older);
    CHECK(farm.versions["new"] == version);
    (void)farm.submit(1, 4); // somebody else has spoken since
    CHECK(farm.heard<RenderTile>("old"));
    CHECK(farm.versions["old"] == older);
    CHECK(farm.heard<RenderTile>("new"));
    CHECK(farm.versions["new"] == version);
    // A process that is another one by the same connection.
    farm.worker_of(version, "old", 3);
    CHECK(farm.versions["old"] == version);
    farm.client_arrives("new");
    (void)farm.submit(2, 1);
    CHECK(farm.versions["old"] == version);
}

TEST_CASE("who has no session is answered in the version that it has spoken") {
    MixedFarm farm;
    farm.say_in(older, "a", FindJob{"cone"});
    CHECK(farm.last<Refused>("a").code == RefusalCode::unknown_peer);
    CHECK(farm.versions["a"] == older);
    farm.event(PeerSpokeRubbish{"b", {ErrorCode::malformed_frame, "noise"}, older});
    CHECK(farm.last<Refused>("b").code == RefusalCode::malformed);
    CHECK(farm.versions["b"] == older);
    farm.event(PeerSpokeRubbish{"c", {ErrorCode::version_mismatch, "version 9"}, 9});
    CHECK(farm.last<Refused>("c").code == RefusalCode::version_mismatch);
    CHECK(farm.versions["c"] == version);
}

TEST_CASE("a session ends with its version") {
    MixedFarm farm;
    farm.worker_of(older, "w", 1);
    farm.say_in(older, "w", Goodbye{});
    farm.say_in(older, "c", ClientHello{"c", "test"});
    farm.say_in(older, "c", Goodbye{});
    farm.say("somebody", ClientHello{"c", "test"});
    farm.say("w", Beat{});
    CHECK(farm.versions["w"] == version);
    farm.say("c", Beat{});
    CHECK(farm.versions["c"] == version);
}

TEST_CASE("what a peer's version does not know is not said to it") {
    MixedFarm farm({"tcp://b:50057"});
    farm.pass(2s); // nobody is there, so it leads
    farm.worker_of(older, "old", 1);
    farm.worker_of(version, "new", 2);
    farm.say_in(older, "old_client", ClientHello{"c", "test"});
    farm.pass(1s);
    CHECK(farm.heard<Brokers>("new"));
    CHECK_FALSE(farm.heard<Brokers>("old"));
    CHECK_FALSE(farm.heard<Brokers>("old_client"));
    // It cannot say what it has in hand, so it is not waited for any longer than others.
    (void)farm.submit(1, 8);
    CHECK(farm.heard<RenderTile>("old"));
}

TEST_CASE("another version is told in the log once, and counted each time") {
    MixedFarm farm;
    const auto told = [&] {
        return std::ranges::count_if(farm.logs,
                                     [](const Log& line) { return line.kind == "wrong_version"; });
    };
    for (int i = 0; i < 100; ++i)
        farm.event(PeerSpokeRubbish{"x", {ErrorCode::version_mismatch, "version 9"}, 9});
    CHECK(farm.dispatcher.counters().wrong_version == 100);
    CHECK(farm.all<Refused>("x").size() == 100);
    CHECK(told() == 1);
    farm.event(PeerSpokeRubbish{"y", {ErrorCode::version_mismatch, "version 8"}, 8});
    CHECK(told() == 2);
    farm.pass(farm.limits.refusal_told_interval);
    farm.event(PeerSpokeRubbish{"x", {ErrorCode::version_mismatch, "version 9"}, 9});
    CHECK(told() == 3);
    // Of the next version: it says hello again in this one, and is not refused then.
    farm.event(
        PeerSpokeRubbish{"z", {ErrorCode::version_mismatch, "version 13"}, Version{version + 1}});
    CHECK(farm.last<Refused>("z").code == RefusalCode::version_mismatch);
    CHECK(farm.versions["z"] == version);
    CHECK(told() == 3);
    CHECK(farm.dispatcher.counters().wrong_version == 102);
}

TEST_CASE("a job that is checked is not there for who knows nothing of distrust") {
    MixedFarm farm;
    farm.worker_of(version, "w", 1);
    const SubmitJob checked = Farm::checked(1, 2);
    (void)farm.submit("client", checked);
    farm.say_in(older, "old", ClientHello{"c", "test"});
    farm.say_in(older, "old", FindJob{to_string(checked.job)});
    CHECK(farm.last<Refused>("old").code == RefusalCode::no_such_job);
    CHECK(farm.last<Refused>("old").reason.find("newer program") != std::string::npos);
    farm.say_in(older, "old", Repair{checked.job, 10, {}});
    CHECK(farm.last<Refused>("old").code == RefusalCode::no_such_job);
    CHECK(farm.last<Refused>("old").job == checked.job);
    // Nor is it taken over.
    SubmitJob same = checked;
    same.job = id_of<JobId>(2);
    same.wishes.verify = 0;
    same.resume = true;
    farm.say_in(older, "old", same);
    CHECK(farm.last<JobState>("old").job == same.job);
    CHECK(farm.state(checked.job).verify == 1);
    farm.say_in(older, "old", FindJob{to_string(same.job)});
    CHECK(farm.last<JobState>("old").job == same.job);
}

TEST_CASE("brokers that stand for each other are of one version") {
    MixedFarm farm({"tcp://b:50057"});
    const BrokerHello hello{.broker = id_of<BrokerId>(5),
                            .started_at = {},
                            .endpoint = "tcp://b:50057",
                            .program_version = "test"};
    for (int i = 0; i < 10; ++i)
        farm.say_in(older, "b", hello);
    CHECK(farm.last<Refused>("b").code == RefusalCode::version_mismatch);
    CHECK(farm.last<Refused>("b").reason ==
          "brokers that stand for each other speak one version of the protocol, and it speaks " +
              std::to_string(older) + ", this one " + std::to_string(version));
    CHECK(farm.dispatcher.membership().peers().empty());
    // The other one refuses this one as well.
    for (int i = 0; i < 10; ++i)
        farm.event(
            BrokerSaid{"tcp://b:50057", Refused{RefusalCode::version_mismatch, {}, "no"}, older});
    for (int i = 0; i < 10; ++i)
        farm.event(BrokerSaid{"tcp://b:50057",
                              Refused{RefusalCode::version_mismatch, {}, "one version 13"}});
    CHECK(farm.dispatcher.membership().peers().empty());
    std::vector<std::string> told;
    for (const Log& line : farm.logs)
        if (line.kind == "no_company")
            told.push_back(line.text);
    REQUIRE(told.size() == 2); // whoever noticed
    CHECK(told[0].starts_with("broker tcp://b:50057 does not stand for this one: "));
    CHECK(told[1] == "broker tcp://b:50057 does not stand for this one: one version 13");
    farm.say("b", hello);
    CHECK(farm.dispatcher.membership().peers().size() == 1);
}
