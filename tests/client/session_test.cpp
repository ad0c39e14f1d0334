#include "client/session.hpp"

#include <doctest/doctest.h>
#include <set>
#include <string>

using namespace fraja;
using namespace fraja::client;
using namespace std::chrono_literals;

namespace {

struct Driver {
    Session session;
    std::vector<Action> actions;
    Instant now{};

    explicit Driver(std::vector<std::string> brokers) : session({std::move(brokers), 10s, "test"}) {
        session.start(now, actions);
    }
    Session::Change step(const Event& event) {
        actions.clear();
        return session.step(now, event, actions);
    }
    Session::Change tick_at_deadline() {
        now = session.next_deadline();
        return step(Tick{});
    }
    template <class M>
    [[nodiscard]] int sent() const {
        int count = 0;
        for (const Action& action : actions)
            if (const auto* send = std::get_if<Send>(&action))
                count += std::holds_alternative<M>(send->message) ? 1 : 0;
        return count;
    }
    [[nodiscard]] std::optional<std::string> connected_to() const {
        for (const Action& action : actions)
            if (const auto* connect = std::get_if<Connect>(&action))
                return connect->broker;
        return std::nullopt;
    }
};

Event welcome(std::uint64_t epoch = 1) {
    return FromBroker{protocol::Welcome{BrokerId{{1}}, epoch, 1s, 3, "tcp://h:1", "test"}};
}

} // namespace

TEST_CASE("a session says hello, is welcome, and beats every heartbeat") {
    Driver d({"a"});
    CHECK(d.connected_to() == "a");
    CHECK(d.sent<protocol::ClientHello>() == 1);
    CHECK(d.step(welcome()) == Session::Change::opened);
    CHECK(d.session.is_open());
    for (int beat = 1; beat <= 5; ++beat) {
        CHECK(d.tick_at_deadline() == Session::Change::none);
        CHECK(d.now == Instant{} + std::chrono::seconds(beat));
        CHECK(d.sent<protocol::Beat>() == 1);
        (void)d.step(FromBroker{protocol::Beat{}});
    }
}

TEST_CASE("a hello that could not be sent is tried again soon, an unanswered one later") {
    Driver d({"a"});
    (void)d.step(NotSent{});
    CHECK(d.session.next_deadline() <= Instant{} + 20ms);
    (void)d.tick_at_deadline();
    CHECK(d.sent<protocol::ClientHello>() == 1);
    CHECK(d.session.next_deadline() == d.now + 1s);
}

TEST_CASE("who is not let in by one of several brokers asks the others, and ends when all say no") {
    const TurnedAway away{"it refuses our key"};
    const FromBroker not_allowed{
        protocol::Refused{protocol::RefusalCode::not_allowed, {}, "no role"}};
    for (const Event& refusal : {Event(away), Event(not_allowed)}) {
        Driver alone({"a"});
        CHECK(alone.step(refusal) == Session::Change::refused);

        Driver d({"a", "b"});
        CHECK(d.step(refusal) == Session::Change::none);
        CHECK(d.connected_to() == "b");
        CHECK(d.step(welcome()) == Session::Change::opened); // that one does, and all is forgotten
        (void)d.step(NotSent{});
        CHECK(d.connected_to() == "a");
        CHECK(d.step(refusal) == Session::Change::none);
        CHECK(d.connected_to() == "b");
        CHECK(d.step(refusal) == Session::Change::refused);
        CHECK(d.session.failure().code == ExitCode::refused);
        CHECK(d.session.failure().reason.starts_with("b: "));
    }
    // What an open session may not do is not asked of another broker.
    Driver open({"a", "b"});
    (void)open.step(welcome());
    CHECK(open.step(not_allowed) == Session::Change::refused);
}

TEST_CASE("no broker within the time to connect is an end") {
    Driver d({"a", "b"});
    std::set<std::string> tried;
    Session::Change change = Session::Change::none;
    while (change == Session::Change::none && d.now < Instant{} + 60s) {
        change = d.tick_at_deadline();
        if (const auto to = d.connected_to())
            tried.insert(*to);
    }
    CHECK(change == Session::Change::gave_up);
    CHECK(d.now == Instant{} + 10s);
    CHECK(d.session.failure().code == ExitCode::unreachable);
    CHECK(tried == std::set<std::string>{"a", "b"});
    CHECK(d.session.next_deadline() == Instant::never());
}

TEST_CASE("a silent broker is lost, said so once, and looked for without end where it matters") {
    Driver d({"a", "b"});
    (void)d.step(welcome());
    d.session.set_patient(true);
    int said = 0;
    while (d.now < Instant{} + 600s) {
        CHECK(d.tick_at_deadline() == Session::Change::none);
        for (const Action& action : d.actions)
            said += std::holds_alternative<News>(action) ? 1 : 0;
    }
    CHECK(said == 1);
    CHECK_FALSE(d.session.is_open());
    CHECK(d.step(welcome()) == Session::Change::opened);
    CHECK(d.actions.size() == 1); // found again
}

TEST_CASE("a broker that was silent more than once is given longer each time, and then forgiven") {
    Driver d({"a"});
    d.session.set_patient(true);
    const auto silence_borne = [&] { // from the welcome to the loss
        REQUIRE(d.step(welcome()) == Session::Change::opened);
        const Instant opened = d.now;
        do
            (void)d.tick_at_deadline();
        while (!d.connected_to());
        return d.now - opened;
    };
    for (const Duration borne : {3s, 6s, 12s, 24s, 24s})
        CHECK(silence_borne() == borne);
    REQUIRE(d.step(welcome()) == Session::Change::opened);
    for (int beat = 0; beat <= 240; ++beat) { // 10 times 24 s, each answered
        (void)d.tick_at_deadline();
        (void)d.step(FromBroker{protocol::Beat{}});
    }
    do
        (void)d.tick_at_deadline();
    while (!d.connected_to());
    CHECK(silence_borne() == 6s); // that was the first one again
}

TEST_CASE("a broker that does not know us is greeted again on the same connection") {
    Driver d({"a", "b"});
    (void)d.step(welcome());
    const Event stranger =
        FromBroker{protocol::Refused{protocol::RefusalCode::unknown_peer, JobId{}, ""}};
    CHECK(d.step(stranger) == Session::Change::none);
    CHECK(d.sent<protocol::ClientHello>() == 1);
    CHECK_FALSE(d.connected_to().has_value());
    CHECK(d.step(stranger) == Session::Change::none); // the answer to what was sent before
    CHECK(d.actions.empty());
    CHECK(d.step(welcome(2)) == Session::Change::opened);
    CHECK(d.step(welcome(2)) == Session::Change::none); // a repeated hello's
}

TEST_CASE("another version is refused, whoever notices") {
    for (const Event& event : {Event(FromBroker{protocol::Refused{
                                   protocol::RefusalCode::version_mismatch, JobId{}, "v9"}}),
                               Event(Undecodable{{ErrorCode::version_mismatch, "v9"}})}) {
        Driver d({"a"});
        CHECK(d.step(event) == Session::Change::refused);
        CHECK(d.session.failure().code == ExitCode::refused);
        CHECK(d.session.failure().reason == "a: v9");
    }
    Driver d({"a"});
    CHECK(d.step(Undecodable{{ErrorCode::malformed_frame, "noise"}}) == Session::Change::none);
}

TEST_CASE("a Welcome with impossible times is bounded") {
    Driver d({"a"});
    (void)d.step(FromBroker{protocol::Welcome{BrokerId{{1}}, 1, Duration(-5), 0, "", ""}});
    CHECK(d.session.next_deadline() > d.now);
    CHECK(d.session.next_deadline() < d.now + 1s);
}

TEST_CASE("a broker of the version before is greeted in that, and so again each time") {
    constexpr protocol::Version older = protocol::oldest_version_spoken;
    const FromBroker refused{
        protocol::Refused{protocol::RefusalCode::version_mismatch, JobId{}, "11"}, older};
    const FromBroker welcome{protocol::Welcome{BrokerId{{1}}, 1, 1s, 3, "", ""}, older};
    const auto speaks = [](const Driver& d) {
        std::vector<protocol::Version> versions;
        for (const Action& action : d.actions)
            if (const auto* speak = std::get_if<Speak>(&action))
                versions.push_back(speak->version);
        return versions;
    };
    using Versions = std::vector<protocol::Version>;
    Driver d({"a"});
    CHECK(speaks(d).empty()); // of itself it is the newest
    CHECK(d.step(refused) == Session::Change::heeded);
    CHECK(speaks(d) == Versions{older});
    CHECK(d.sent<protocol::ClientHello>() == 1);
    CHECK(d.step(refused) == Session::Change::heeded); // it comes twice, as a hello may have
    CHECK(d.actions.empty());
    CHECK(d.step(welcome) == Session::Change::opened);
    CHECK(d.session.spoken() == older);
    // One of this version comes in its place, and then again the older one.
    CHECK(d.step(FromBroker{protocol::Refused{protocol::RefusalCode::unknown_peer, JobId{}, ""},
                            older}) == Session::Change::none);
    CHECK(speaks(d) == Versions{protocol::version});
    CHECK(d.sent<protocol::ClientHello>() == 1);
    CHECK(d.step(FromBroker{protocol::Welcome{BrokerId{{2}}, 2, 1s, 3, "", ""}}) ==
          Session::Change::opened);
    CHECK(speaks(d).empty());
    CHECK(d.step(refused) == Session::Change::heeded);
    CHECK_FALSE(d.session.is_open());
    CHECK(speaks(d) == Versions{older});
    // A hello that is said again begins anew; a Welcome that comes nevertheless says what is
    // spoken.
    (void)d.tick_at_deadline();
    CHECK(speaks(d) == Versions{protocol::version});
    CHECK(d.step(welcome) == Session::Change::opened);
    CHECK(speaks(d) == Versions{older});
    CHECK(d.step(refused) == Session::Change::heeded);
    CHECK(d.session.is_open());
}
