#include "common/discovery/srv_lookup.hpp"

#include "tests/support/dns_server.hpp"

#include <doctest/doctest.h>
#include <string>
#include <thread>
#include <vector>

using namespace fraja;
using namespace fraja::discovery;
using namespace std::chrono_literals;

namespace {

const std::string name = "_fraja._tcp.farm.test";

Result<std::vector<SrvRecord>> ask(const DnsServer& server, const std::string& what,
                                   DnsOptions options = {}) {
    options.servers = server.address();
    return look_up_srv(what, options, {});
}

} // namespace

TEST_CASE("look_up_srv brings the records that a server has") {
    DnsServer server;
    server.set(name, {.records = {{10, 1, 50057, "a.test"}, {20, 2, 7, "b.test"}}});
    const auto records = ask(server, name);
    REQUIRE(records);
    CHECK(*records == std::vector<SrvRecord>{{10, 1, 50057, "a.test"}, {20, 2, 7, "b.test"}});
}

TEST_CASE("look_up_srv asks by TCP for what is too long for UDP") {
    DnsServer server;
    DnsReply reply{.truncated = true};
    for (std::uint16_t i = 1; i <= 60; ++i)
        reply.records.push_back({0, 0, i, "a-host-with-a-long-name.farm.test"});
    server.set(name, reply);
    const auto records = ask(server, name);
    REQUIRE(records);
    CHECK(records->size() == 60);
    CHECK(server.question_count() == 2);
}

TEST_CASE("look_up_srv tells apart why there are no records") {
    DnsServer server;
    server.set(name, {});
    server.set("_fraja._tcp.broken.test", {.code = 2});
    struct Row {
        std::string name;
        Error want;
    };
    for (const Row& row : std::vector<Row>{
             {name, {ErrorCode::not_found, "the name has no SRV records"}},
             {"_fraja._tcp.nobody.test", {ErrorCode::not_found, "the DNS knows no such name"}},
             {"_fraja._tcp.broken.test",
              {ErrorCode::unreachable, "the DNS servers cannot be reached, or fail"}},
         }) {
        CAPTURE(row.name);
        const auto records = ask(server, row.name);
        REQUIRE_FALSE(records);
        CHECK(records.error().message == row.want.message);
        CHECK(records.error().code == row.want.code);
    }
}

TEST_CASE("look_up_srv gives up on a silent server, and at once when it is told to") {
    DnsServer server;
    server.set(name, {.silent = true});
    const auto records = ask(server, name, {.timeout = 20ms, .tries = 2});
    REQUIRE_FALSE(records);
    CHECK(records.error() == Error{ErrorCode::unreachable, "no DNS server answers"});
    CHECK(server.question_count() == 2);

    const net::Waker waker;
    std::stop_source stop;
    std::jthread other([&] {
        while (server.question_count() < 3) // it has been asked
            std::this_thread::yield();
        stop.request_stop();
        waker.wake();
    });
    const auto stopped =
        look_up_srv(name, {.servers = server.address(), .timeout = 1h}, {stop.get_token(), &waker});
    REQUIRE_FALSE(stopped);
    CHECK(stopped.error().code == ErrorCode::cancelled);
}
