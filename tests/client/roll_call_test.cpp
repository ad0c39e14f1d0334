// Brokers of few words that are asked over real sockets, all at the same time.
#include "client/roll_call.hpp"

#include "common/net/clock.hpp"
#include "tests/client/farm_teller.hpp"
#include "tests/client/written.hpp"

#include <csignal>
#include <doctest/doctest.h>
#include <pthread.h>

using namespace fraja;
using namespace fraja::client;
using namespace std::chrono_literals;

namespace {

constexpr const char* nobody = "tcp://127.0.0.1:1"; // nothing listens there

protocol::PeerState peer(std::uint8_t id, std::string endpoint, bool is_here) {
    return {.broker = BrokerId{{id}},
            .endpoint = std::move(endpoint),
            .program_version = "1",
            .is_here = is_here,
            .is_synced = true,
            .leads = false};
}

/// A timeout that no test waits for.
SessionOptions patient(Duration connect_timeout = 24h) {
    return {{nobody}, connect_timeout, "test"};
}

SearchNotice silent(Written& written) {
    return {written.console, ProgressMode::none, {nobody}, net::now()};
}

AskedBroker answered(std::uint8_t id, std::string endpoint,
                     std::vector<protocol::PeerState> others = {}) {
    AskedBroker asked{std::move(endpoint), protocol::FarmState{}, ""};
    asked.farm->broker.broker = BrokerId{{id}};
    asked.farm->brokers = std::move(others);
    return asked;
}

} // namespace

TEST_CASE("brokers that do not answer keep nobody waiting once one has") {
    const net::Context context;
    Written written({.program = "fraja-test"});
    const auto mute = net::RouterSocket::bind(context, "tcp://127.0.0.1:0");
    REQUIRE(mute.has_value());
    const FarmTeller teller(
        context, 1, {peer(2, "tcp://127.0.0.1:2", false), peer(3, "tcp://127.0.0.1:3", true)});
    RollCall call(context, {nobody, mute->endpoint(), teller.endpoint()}, patient(),
                  silent(written));
    const Instant begin = net::now();
    CHECK(call.hold(nullptr) == Outcome{});
    CHECK(net::now() - begin < 20s); // the machine may be busy; a timeout would have been a day
    const auto all = call.brokers();
    REQUIRE(all.size() == 5);
    struct Row {
        std::string endpoint, trouble;
    };
    std::size_t i = 0;
    for (const Row& row :
         {Row{nobody, "gone: nothing listens there"}, Row{mute->endpoint(), "does not answer"},
          Row{teller.endpoint(), ""}, Row{"tcp://127.0.0.1:2", "gone: nothing listens there"},
          Row{"tcp://127.0.0.1:3", "not reached from here: nothing listens there"}}) {
        CHECK(all[i].endpoint == row.endpoint);
        CHECK(all[i].trouble == row.trouble);
        CHECK(all[i].farm.has_value() == row.trouble.empty());
        ++i;
    }
}

TEST_CASE("where nobody answers each has its time, and all of that is over at once") {
    const net::Context context;
    Written written({.program = "fraja-test"});
    RollCall call(context, {nobody, "tcp://127.0.0.1:2"}, patient(100ms), silent(written));
    const Outcome outcome = call.hold(nullptr);
    CHECK(outcome.code == ExitCode::unreachable);
    CHECK(outcome.reason == "no broker answers at tcp://127.0.0.1:1, tcp://127.0.0.1:2 "
                            "(fraja-broker starts one, -b HOST:PORT names another)");
    CHECK(call.brokers().size() == 2);
}

TEST_CASE("a signal ends a roll call") {
    const net::SignalWatch signals({SIGTERM});
    const net::Context context;
    Written written({.program = "fraja-test"});
    RollCall call(context, {nobody}, patient(), silent(written));
    pthread_kill(pthread_self(), SIGTERM); // it is blocked, so it waits to be read
    CHECK(call.hold(&signals).code == ExitCode::terminated);
}

TEST_CASE("a broker at two addresses is there once") {
    const auto once = each_once(
        {answered(1, "tcp://a:1"), answered(2, "tcp://b:1"), answered(1, "tcp://[fe80::1]:1")});
    REQUIRE(once.size() == 2);
    CHECK(once[0].endpoint == "tcp://a:1");
    CHECK(once[0].also_at == std::vector<std::string>{"tcp://[fe80::1]:1"});
    CHECK(once[1].also_at.empty());
}

TEST_CASE("a broker that answers elsewhere is not gone where others say it is") {
    const auto unanswered = [](std::string endpoint) {
        return AskedBroker{std::move(endpoint), std::nullopt, "gone"};
    };
    const auto once = each_once(
        {answered(1, "tcp://a:1", {peer(1, "tcp://inside:1", true), peer(2, "tcp://b:1", false)}),
         unanswered("tcp://inside:1"), unanswered("tcp://b:1")});
    REQUIRE(once.size() == 2);
    CHECK(once[0].endpoint == "tcp://a:1");
    CHECK(once[1].endpoint == "tcp://b:1");
}
