// Those who keep a server waiting: for how long each is borne, and that nobody else waits.
#include "common/net/clock.hpp"
#include "tests/common/http/running.hpp"

#include <atomic>
#include <doctest/doctest.h>
#include <optional>
#include <string>
#include <thread>
#include <vector>

using namespace fraja;
using namespace fraja::http;
using namespace std::chrono_literals;

namespace {

/// Whoever is waited for is waited for longer than any test.
constexpr Limits patient{
    .threads = 1, .connections_max = 300, .request_time_max = 1h, .idle_max = 1h, .patience = 1h};

} // namespace

TEST_CASE("200 connections that are idle keep nobody waiting, and are kept") {
    const Running server(patient);
    std::vector<Connection> fresh, used;
    for (int i = 0; i < 100; ++i) {
        fresh.emplace_back(server.port);
        REQUIRE(asks(used.emplace_back(server.port)));
    }
    for (int i = 0; i < 20; ++i)
        CHECK(server.ask() == 200);
    for (std::size_t i = 0; i < 100; ++i) {
        CHECK(asks(fresh[i]));
        CHECK(asks(used[i]));
    }
}

TEST_CASE("50 requests that trickle keep nobody waiting, and are answered in the end") {
    const Running server(patient);
    std::vector<Connection> trickling;
    for (int i = 0; i < 50; ++i)
        trickling.emplace_back(server.port);
    for (const char byte : std::string_view(page_request)) {
        for (Connection& connection : trickling)
            REQUIRE(connection.say({&byte, 1}));
        CHECK(server.ask() == 200);
    }
    for (Connection& connection : trickling)
        CHECK(connection.read_until("words", patience).has_value());
}

TEST_CASE("a request has request_time_max to be whole, however it trickles, and is then told so") {
    Limits limits = patient;
    limits.request_time_max = 300ms;
    const Running server(limits);
    Connection trickling(server.port), silent(server.port);
    const Instant begin = net::now();
    trickling.say("GET /page HTTP/1.1\r\n");
    std::optional<std::string> told;
    while (!told && trickling.say("A"))
        told = trickling.read_until("at once.\n", 10ms);
    CHECK(net::now() - begin >= limits.request_time_max);
    REQUIRE(told);
    CHECK(told->starts_with("HTTP/1.1 408 "));
    CHECK(asks(silent)); // its time begins with its first byte
}

TEST_CASE("a connection without a request is closed after idle_max") {
    Limits limits = patient;
    limits.idle_max = 300ms;
    const Running server(limits);
    const Instant begin = net::now();
    Connection fresh(server.port);
    CHECK(fresh.read_to_end(patience) == "");
    CHECK(net::now() - begin >= limits.idle_max);
    Connection used(server.port);
    REQUIRE(asks(used));
    CHECK(used.read_to_end(patience) == "");
}

TEST_CASE("who takes nothing of an answer is given up after `patience`") {
    Limits limits = patient;
    limits.patience = 300ms;
    const auto large = body(std::string(64'000'000, 'x'));
    std::atomic<bool> is_asked = false;
    const Running server(limits, [&](const Request& request) {
        is_asked = request.path == "/large";
        return is_asked ? Answer{.body = large} : one_page(request);
    });
    Connection slow(server.port);
    slow.say("GET /large HTTP/1.1\r\n\r\n");
    while (!is_asked)
        std::this_thread::yield();
    CHECK(server.ask() == 200);
    while (large.use_count() > 1)
        std::this_thread::yield();
    CHECK(slow.read_to_end(patience).value_or("").size() < large->size());
}

TEST_CASE("who has all and does not close is given up after `patience`") {
    Limits limits = patient;
    limits.patience = 300ms;
    const Running server(limits);
    Connection connection(server.port);
    connection.say("rubbish\r\n\r\n");
    CHECK(connection.read_to_end(patience).has_value()); // nothing more is sent
    while (connection.say("more"))
        CHECK(server.ask() == 200);
}

TEST_CASE("for who comes beyond connections_max the one that is idle for longest is given up, and "
          "only then a request that is not whole") {
    Limits limits = patient;
    limits.connections_max = 3;
    const Running server(limits);
    Connection half(server.port), oldest(server.port), older(server.port);
    half.say("GET /pa");
    REQUIRE(asks(oldest));
    REQUIRE(asks(older));
    Connection first(server.port);
    REQUIRE(asks(first));
    CHECK(oldest.read_to_end(patience) == "");
    Connection second(server.port);
    REQUIRE(asks(second));
    CHECK(older.read_to_end(patience) == "");
    half.say("ge HTTP/1.1\r\n\r\n");
    CHECK(half.read_until("words", patience).has_value());

    std::vector<Connection> halves;
    for (int i = 0; i < 200; ++i)
        halves.emplace_back(server.port).say("GET /pa");
    CHECK(server.ask() == 200);
    CHECK(halves.front().read_to_end(patience) == "");
}
