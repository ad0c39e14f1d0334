// The doctor over real sockets.
#include "client/doctor.hpp"

#include "tests/client/farm_teller.hpp"

#include <algorithm>
#include <csignal>
#include <doctest/doctest.h>
#include <pthread.h>

using namespace fraja;
using namespace fraja::client;

namespace {

SharedOptions asking(std::vector<std::string> brokers) {
    SharedOptions shared;
    shared.brokers = std::move(brokers);
    return shared;
}

} // namespace

TEST_CASE("a doctor that is interrupted says so, and nothing of the brokers") {
    const net::SignalWatch signals({SIGINT, SIGTERM});
    const net::Context context;
    const auto mute = net::RouterSocket::bind(context, "tcp://127.0.0.1:0");
    REQUIRE(mute.has_value());
    for (const auto& [signal, want] :
         {std::pair{SIGINT, ExitCode::interrupted}, std::pair{SIGTERM, ExitCode::terminated}}) {
        pthread_kill(pthread_self(), signal); // it is blocked, so it waits to be read
        const auto examined = examine_brokers(asking({mute->endpoint()}), &signals);
        CHECK(examined.outcome.code == want);
    }
    // In the middle of it: as soon as it speaks.
    std::jthread interrupting([&, doctor = pthread_self()] {
        net::wait({*mute}, std::chrono::minutes(1));
        pthread_kill(doctor, SIGTERM);
    });
    const auto examined = examine_brokers(asking({mute->endpoint()}), &signals);
    CHECK(examined.outcome.code == ExitCode::terminated);
    CHECK(std::ranges::count(examined.findings, Finding::Grade::bad, &Finding::grade) == 0);
}

TEST_CASE("a broker that a doctor reaches by two addresses is looked at once") {
    const net::Context context;
    const FarmTeller teller(context, 1), other(context, 2);
    const std::string port = teller.endpoint().substr(teller.endpoint().rfind(':'));
    const std::string again = "tcp://localhost" + port;
    const auto examined =
        examine_brokers(asking({teller.endpoint(), again, other.endpoint()}), nullptr);
    CHECK(examined.outcome == Outcome{});
    CHECK(std::ranges::count(examined.findings, "clocks", &Finding::subject) == 2);
    const auto same = std::ranges::find(examined.findings, again, &Finding::subject);
    REQUIRE(same != examined.findings.end());
    CHECK(same->text.ends_with(": the same broker"));
    CHECK(std::ranges::count(examined.findings, again, &Finding::subject) == 1);
}
