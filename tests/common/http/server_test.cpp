#include "common/http/server.hpp"

#include "common/net/clock.hpp"
#include "tests/common/http/running.hpp"

#include <atomic>
#include <barrier>
#include <doctest/doctest.h>
#include <latch>
#include <optional>
#include <string>
#include <sys/resource.h>
#include <thread>
#include <unistd.h>
#include <vector>

using namespace fraja;
using namespace fraja::http;
using namespace std::chrono_literals;

TEST_CASE("a connection is kept for more requests, and they may be sent ahead") {
    const Running server;
    Connection connection(server.port);
    for (int i = 0; i < 20; ++i)
        REQUIRE(asks(connection));
    std::string ahead;
    for (int i = 0; i < 20; ++i)
        ahead += page_request;
    connection.say(ahead + "GET /other HTTP/1.1\r\nConnection: close\r\n\r\n");
    const auto answers = connection.read_to_end(patience);
    REQUIRE(answers);
    CHECK(answers->ends_with("only /page\n"));
    std::size_t words = 0;
    for (std::size_t at = 0; (at = answers->find("words", at)) != std::string::npos; ++at)
        ++words;
    CHECK(words == 20);
}

TEST_CASE("a request may come in any pieces") {
    const Running server;
    Connection connection(server.port);
    const std::string_view request = page_request;
    for (std::size_t i = 0; i < request.size(); ++i) {
        connection.say(request.substr(i, 1));
        CHECK(server.ask() == 200); // so it has been read
    }
    CHECK(connection.read_until("words", patience));
}

TEST_CASE("who closes its end is still answered, and who says nothing more is let go") {
    const Running server;
    Connection asked(server.port), half(server.port), silent(server.port);
    asked.say(page_request);
    half.say("GET /pa");
    for (Connection* connection : {&asked, &half, &silent})
        connection->close_writing();
    CHECK(asked.read_to_end(patience).value_or("").ends_with("words"));
    CHECK(half.read_to_end(patience) == "");
    CHECK(silent.read_to_end(patience) == "");
}

TEST_CASE("a line, headers or a body that are too large are refused, and their sender sees that") {
    const Limits limits;
    const Running server(limits);
    std::string headers = "GET /page HTTP/1.1\r\n";
    while (headers.size() <= limits.request_bytes_max)
        headers += "A: b\r\n";
    const std::string line = "GET /" + std::string(limits.request_line_bytes_max, 'x');
    struct Row {
        std::string request, status;
    };
    for (const Row& row :
         {Row{line, "414"}, Row{line + " HTTP/1.1\r\n\r\n", "414"}, Row{headers, "431"},
          Row{headers + "\r\n", "431"},
          Row{"POST /page HTTP/1.1\r\nContent-Length: 100000\r\n\r\n" + std::string(100'000, 'x'),
              "413"}}) {
        CAPTURE(row.request.substr(0, 20));
        Connection connection(server.port);
        connection.say(row.request);
        CHECK(connection.read_until("\n", patience).has_value());
        connection.close_writing();
        CHECK(connection.read_to_end(patience).has_value());
        Connection again(server.port);
        again.say(row.request);
        again.close_writing();
        CHECK(again.read_to_end(patience).value_or("").starts_with("HTTP/1.1 " + row.status));
    }
    const std::string longest(
        limits.request_line_bytes_max - std::string_view("GET / HTTP/1.1\r").size(), 'x');
    Connection fits(server.port);
    fits.say("GET /" + longest + " HTTP/1.1\r\nConnection: close\r\n\r\n");
    CHECK(fits.read_to_end(patience).value_or("").starts_with("HTTP/1.1 404 "));
    CHECK(server.ask() == 200);
}

TEST_CASE("an answer of any size arrives whole") {
    std::string text;
    for (int i = 0; text.size() < 30'000'000; ++i)
        text += std::to_string(i) + " ";
    const auto large = body(std::move(text));
    const Running server({.threads = 1, .patience = 1h},
                         [&](const Request&) { return Answer{.body = large}; });
    for (int i = 0; i < 3; ++i)
        CHECK((ask_http(server.port, "GET", "/", patience).body == *large));
}

TEST_CASE("so many requests are answered at once as there are threads") {
    const Limits limits{.threads = 3};
    std::barrier all(3);
    std::atomic<std::size_t> inside = 0;
    std::atomic<bool> too_many = false;
    const Running server(limits, [&](const Request& request) {
        if (++inside > limits.threads)
            too_many = true;
        all.arrive_and_wait();
        --inside;
        return one_page(request);
    });
    std::vector<Connection> connections;
    for (std::size_t i = 0; i < 4 * limits.threads; ++i)
        connections.emplace_back(server.port).say(page_request);
    for (Connection& connection : connections)
        CHECK(connection.read_until("words", patience).has_value());
    CHECK_FALSE(too_many);
}

TEST_CASE("when all are being answered, one more is told so at once, and nobody is given up") {
    const Limits limits{.threads = 5, .connections_max = 5};
    std::atomic<std::size_t> asked = 0;
    std::latch go(1);
    const Running server(limits, [&](const Request& request) {
        ++asked;
        go.wait();
        return one_page(request);
    });
    std::vector<Connection> held;
    for (std::size_t i = 0; i < limits.connections_max; ++i)
        held.emplace_back(server.port).say(page_request);
    while (asked < limits.connections_max)
        std::this_thread::yield();
    int told = 0;
    for (int i = 0; i < 200; ++i)
        told += server.ask() == 503;
    CHECK(told == 200);
    go.count_down();
    for (Connection& connection : held)
        CHECK(connection.read_until("words", patience).has_value());
    CHECK(server.ask() == 200);
}

TEST_CASE("a server that ends waits for nobody who is connected") {
    const Limits limits{.request_time_max = 1h, .idle_max = 1h, .patience = 1h};
    std::optional<Running> server(std::in_place, limits, [](const Request& request) {
        return request.path == "/large" ? Answer{.body = body(std::string(100'000'000, 'x'))}
                                        : one_page(request);
    });
    std::vector<Connection> held;
    for (int i = 0; i < 5; ++i) {
        held.emplace_back(server->port);
        held.emplace_back(server->port).say("GET /page");
        held.emplace_back(server->port).say("GET /large HTTP/1.1\r\n\r\n");
    }
    CHECK(server->ask() == 200);
    const Instant begin = net::now();
    server.reset();
    CHECK(net::now() - begin < patience);
    for (Connection& connection : held)
        CHECK(connection.read_to_end(patience).has_value());
}

TEST_CASE("a server that has no descriptor left gives up who is idle for who comes") {
    const Running server;
    Connection idle(server.port);
    REQUIRE(asks(idle));
    rlimit before{};
    REQUIRE(getrlimit(RLIMIT_NOFILE, &before) == 0);
    rlimit few = before;
    few.rlim_cur = 200;
    REQUIRE(setrlimit(RLIMIT_NOFILE, &few) == 0);
    std::vector<int> taken;
    for (int fd; (fd = dup(0)) >= 0;)
        taken.push_back(fd);
    REQUIRE_FALSE(taken.empty());
    close(taken.back()); // the other end's own
    taken.pop_back();
    const int status = server.ask();
    for (const int fd : taken)
        close(fd);
    setrlimit(RLIMIT_NOFILE, &before);
    CHECK(status == 200);
    CHECK(idle.read_to_end(patience) == "");
}
