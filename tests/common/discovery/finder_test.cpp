#include "common/discovery/finder.hpp"

#include "tests/support/dns_server.hpp"

#include <doctest/doctest.h>
#include <poll.h>
#include <string>
#include <vector>

using namespace fraja;
using namespace fraja::discovery;
using namespace std::chrono_literals;

namespace {

const std::string source = "srv:_fraja._tcp.farm.test", farm_name = "_fraja._tcp.farm.test";
constexpr int pause_max_ms = 20;
constexpr int finding_ms = 20'000; // passes at once, unless something is wrong

FinderOptions options_of(const DnsServer& server) {
    return {.dns = {.servers = server.address()},
            .pause_first = 10ms,
            .pause_max = std::chrono::milliseconds(pause_max_ms)};
}

Findings next_of(Finder& finder) {
    for (;;) {
        if (const auto all = finder.take(); !all.empty()) {
            REQUIRE(all.size() == 1);
            return all.front();
        }
        pollfd readable{finder.fd(), POLLIN, 0};
        REQUIRE(::poll(&readable, 1, finding_ms) == 1);
    }
}

} // namespace

TEST_CASE("a finder tells what the DNS names, and asks again while a broker is wanted") {
    DnsServer server;
    Finder finder({source}, options_of(server));
    CHECK(next_of(finder) == Findings{source, {}, "the DNS knows no such name"});
    server.set(farm_name, {.records = {{0, 0, 7, "a.test"}}});
    CHECK(next_of(finder) == Findings{source, {"tcp://a.test:7"}, ""});
    server.set(farm_name, {.records = {{0, 0, 7, "b.test"}}});
    CHECK(next_of(finder) == Findings{source, {"tcp://b.test:7"}, ""});
    // A server that fails for a while takes nothing away.
    server.set(farm_name, {.code = 2});
    const Findings kept = next_of(finder);
    CHECK(kept.endpoints == std::vector<std::string>{"tcp://b.test:7"});
    CHECK(kept.trouble == "the DNS servers cannot be reached, or fail");
}

TEST_CASE("a finder lets the DNS alone while no broker is wanted") {
    DnsServer server;
    server.set(farm_name, {.records = {{0, 0, 7, "a.test"}}});
    Finder finder({source}, options_of(server));
    (void)next_of(finder);
    finder.set_wanted(false);
    // What was under way comes to an end, and then nothing more is asked, or this goes on for ever.
    pollfd readable{finder.fd(), POLLIN, 0};
    for (std::size_t before = 0; before != server.question_count();) {
        before = server.question_count();
        (void)::poll(&readable, 1, 10 * pause_max_ms);
        (void)finder.take();
    }
    server.set(farm_name, {.records = {{0, 0, 7, "b.test"}}});
    finder.set_wanted(true);
    CHECK(next_of(finder) == Findings{source, {"tcp://b.test:7"}, ""});
}

TEST_CASE("a finder is gone at once while its server is silent") {
    DnsServer server;
    server.set(farm_name, {.silent = true});
    FinderOptions options = options_of(server);
    options.dns.timeout = 1h;
    { const Finder finder({source, "auto"}, options); }
}
