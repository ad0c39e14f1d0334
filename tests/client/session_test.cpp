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

    explicit Driver(std::vector<std::string> brokers)
        : Driver(SessionOptions{std::move(brokers), 10s, "test"}) {}
    explicit Driver(SessionOptions options) : session(std::move(options)) {
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

template <class A>
int count_of(const std::vector<Action>& actions) {
    int count = 0;
    for (const Action& action : actions)
        count += std::holds_alternative<A>(action) ? 1 : 0;
    return count;
}

const std::string nobody = "none announces itself on this network (fraja-broker --announce)";

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

TEST_CASE("a broker of the own process is not lost, however long it does not get its turn") {
    Driver d(
        SessionOptions{.brokers = {"inproc://a"}, .client_name = "test", .is_in_process = true});
    (void)d.step(welcome());
    (void)d.step(FromBroker{protocol::Beat{}});
    while (d.now < Instant{} + 1h) {
        REQUIRE(d.tick_at_deadline() == Session::Change::none);
        REQUIRE(d.session.is_open());
        REQUIRE(count_of<News>(d.actions) == 0);
    }
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

TEST_CASE("a source is looked at in its turn, and who is found there is asked next") {
    Driver d({"auto", "a"});
    CHECK(count_of<Look>(d.actions) == 1);
    CHECK_FALSE(d.connected_to());
    CHECK(d.sent<protocol::ClientHello>() == 0);
    (void)d.step(NotSent{}); // nothing was to be sent
    CHECK(d.session.next_deadline() > d.now + 1s);
    CHECK(d.step(BrokersFound{"auto", {"b", "c"}, ""}) == Session::Change::none);
    CHECK(d.connected_to() == "b");
    CHECK(d.sent<protocol::ClientHello>() == 1);
    (void)d.tick_at_deadline(); // another hello
    while (!d.connected_to())
        (void)d.tick_at_deadline();
    CHECK(d.connected_to() == "c");
    CHECK(d.step(welcome()) == Session::Change::opened);
    CHECK(count_of<StopLooking>(d.actions) == 1);
    // When it is lost the others have their turn, and then the source.
    (void)d.step(NotSent{});
    CHECK(d.connected_to() == "a");
    do
        (void)d.tick_at_deadline();
    while (count_of<Look>(d.actions) == 0);
    CHECK_FALSE(d.connected_to());
    // What was known is told again; it need not be the same.
    (void)d.step(BrokersFound{"auto", {"d"}, ""});
    CHECK(d.connected_to() == "d");
    (void)d.step(TurnedAway{"no"});
    CHECK(d.connected_to() == "a"); // b and c are not found any more
}

TEST_CASE("a source alone is waited at, and what it lacks is said in the end") {
    struct Row {
        std::string source, trouble, want;
    };
    for (const Row& row : {
             Row{"auto", "", "no broker was found by auto: " + nobody},
             Row{"auto", "only brokers with keys announce themselves here",
                 "no broker was found by auto: only brokers with keys announce themselves here"},
             Row{"srv:x", "the DNS knows no such name",
                 "no broker was found by srv:x: the DNS knows no such name"},
         }) {
        CAPTURE(row.want);
        Driver d({row.source});
        (void)d.step(BrokersFound{row.source, {}, row.trouble});
        CHECK(d.actions.empty());
        CHECK(d.session.next_deadline() == Instant{} + 10s);
        CHECK(d.tick_at_deadline() == Session::Change::gave_up);
        CHECK(d.session.failure() == Outcome{ExitCode::unreachable, row.want});
    }
    Driver patient({"auto"});
    patient.session.set_patient(true);
    CHECK(patient.session.next_deadline() > Instant{} + 24h);
    (void)patient.step(BrokersFound{"auto", {"a"}, ""});
    CHECK(patient.connected_to() == "a");
}

TEST_CASE("a source that knows nobody gives way to those beside it") {
    Driver d({"srv:x", "a"});
    (void)d.step(BrokersFound{"srv:x", {}, "the DNS knows no such name"});
    CHECK(d.connected_to() == "a");
    // One that says nothing has its time.
    Driver silent({"auto", "a"});
    (void)silent.tick_at_deadline();
    CHECK(silent.now == Instant{} + 5s);
    CHECK(silent.connected_to() == "a");
}

TEST_CASE("who is found and says no does not end the search, nor hurries it") {
    Driver d({"auto"});
    for (int round = 0; round < 5; ++round) {
        CAPTURE(round);
        (void)d.step(BrokersFound{"auto", {"impostor"}, ""});
        CHECK(d.connected_to() == "impostor");
        const Event no =
            round % 2 == 0
                ? Event(TurnedAway{"its key is another"})
                : Event(Undecodable{{ErrorCode::version_mismatch, "it speaks version 1"}});
        CHECK(d.step(no) == Session::Change::none);
        CHECK(count_of<Look>(d.actions) == 0); // it was looked at just now
        CHECK(d.tick_at_deadline() == Session::Change::none);
        CHECK(count_of<Look>(d.actions) == 1);
        CHECK(d.now == Instant{} + std::chrono::seconds(round + 1));
    }
    (void)d.step(BrokersFound{"auto", {"impostor", "own"}, ""});
    (void)d.step(TurnedAway{"its key is another"});
    CHECK(d.connected_to() == "own");
    CHECK(d.step(welcome()) == Session::Change::opened);

    // If nobody else comes, what they said is why.
    Driver alone({"auto"});
    (void)alone.step(BrokersFound{"auto", {"a"}, ""});
    (void)alone.step(TurnedAway{"your key is unknown"});
    Session::Change change = Session::Change::none;
    while (change == Session::Change::none)
        change = alone.tick_at_deadline();
    CHECK(change == Session::Change::refused);
    CHECK(alone.now == Instant{} + 10s);
    CHECK(alone.session.failure() == Outcome{ExitCode::refused, "a: your key is unknown"});
}

TEST_CASE("a broker is unproven that is known by announcements alone, where there are no keys") {
    const auto is_unproven = [](std::vector<std::string> brokers, const std::string& source,
                                bool has_keys) {
        Session session({std::move(brokers), 10s, "test", has_keys});
        std::vector<Action> actions;
        session.start({}, actions);
        (void)session.step({}, BrokersFound{source, {"b"}, ""}, actions);
        actions.clear();
        (void)session.step({}, welcome(), actions);
        for (const Action& action : actions)
            if (const auto* news = std::get_if<News>(&action))
                if (const auto* connection = std::get_if<ConnectionChanged>(news))
                    return connection->is_unproven;
        FAIL("not connected");
        return false;
    };
    CHECK(is_unproven({"auto"}, "auto", false));
    CHECK_FALSE(is_unproven({"auto"}, "auto", true));
    CHECK_FALSE(is_unproven({"auto", "b"}, "auto", false)); // it was given
    CHECK_FALSE(is_unproven({"srv:x", "auto"}, "srv:x", false));
}

TEST_CASE("of a source no more are asked than a sound one has") {
    Driver d({"auto"});
    std::vector<std::string> many;
    for (int i = 0; i < 1000; ++i)
        many.push_back("h" + std::to_string(i));
    (void)d.step(BrokersFound{"auto", many, ""});
    std::set<std::string> tried;
    d.session.set_patient(true);
    for (int i = 0; i < 200; ++i) {
        if (const auto to = d.connected_to())
            tried.insert(*to);
        (void)d.step(TurnedAway{"no"});
        while (!d.connected_to())
            if ((void)d.tick_at_deadline(); count_of<Look>(d.actions) > 0)
                (void)d.step(BrokersFound{"auto", many, ""});
    }
    CHECK(tried.size() == 64);
}

TEST_CASE("a broker tells of others, but not where to look for them") {
    Driver d({"a"});
    protocol::Welcome told{BrokerId{{1}}, 1, 1s, 3, "tcp://h:1", "test"};
    told.brokers = {{BrokerId{{2}}, "auto"}, {BrokerId{{3}}, "srv:evil"}, {BrokerId{{4}}, "b"}};
    (void)d.step(FromBroker{told});
    (void)d.step(NotSent{});
    CHECK(d.connected_to() == "b");
    (void)d.step(TurnedAway{"no"});
    CHECK(d.connected_to() == "a");
}
