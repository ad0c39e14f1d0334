#include "broker/http_server.hpp"

#include "common/net/clock.hpp"
#include "tests/support/connection.hpp"

#include <doctest/doctest.h>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

using namespace fraja;
using namespace fraja::broker;
using namespace std::chrono_literals;

namespace {

constexpr Duration patience = 60s;

HttpServer::Pages one_page() {
    return {{"/page", [] { return HttpPage{200, "text/plain", "words"}; }}};
}

/// A server on a port that the system chose.
class Running {
public:
    explicit Running(HttpLimits limits = {}, HttpServer::Pages pages = one_page())
        : server_(*HttpServer::bind("tcp://127.0.0.1:0", std::move(pages), limits)),
          port(port_of(server_.address())) {
        server_.serve();
    }

private:
    HttpServer server_;

public:
    const std::uint16_t port;
};

} // namespace

TEST_CASE("a page is answered to GET, its head to HEAD, and the rest is told what there is") {
    const Running server;
    const HttpAnswer page = http(server.port, "GET", "/page?with=a+query", patience);
    CHECK(page.status == 200);
    CHECK(page.body == "words");
    CHECK(page.head.find("Content-Type: text/plain") != std::string::npos);
    CHECK(page.head.find("Connection: close") != std::string::npos);
    const HttpAnswer head = http(server.port, "HEAD", "/page", patience);
    CHECK(head.status == 200);
    CHECK(head.head.find("Content-Length: 5") != std::string::npos);
    CHECK(head.body.empty());
    const HttpAnswer nothing = http(server.port, "GET", "/pages", patience);
    CHECK(nothing.status == 404);
    CHECK(nothing.body.find("there is /page") != std::string::npos);
    for (const char* method : {"POST", "PUT", "DELETE", "OPTIONS", "PATCH"}) {
        CAPTURE(method);
        const HttpAnswer refused = http(server.port, method, "/page", patience);
        CHECK(refused.status == 405);
        CHECK(refused.head.find("Allow: GET, HEAD") != std::string::npos);
    }
}

TEST_CASE("a body is not waited for, and its sender sees the answer") {
    const Running server;
    Connection connection(server.port);
    connection.say("POST /page HTTP/1.1\r\nContent-Length: 4000\r\n\r\n" + std::string(4000, 'x'));
    connection.close_writing();
    const auto answer = connection.read_to_end(patience);
    REQUIRE(answer.has_value());
    CHECK(answer->starts_with("HTTP/1.1 405 "));
}

TEST_CASE("rubbish ends its connection and nothing else") {
    const Running server;
    for (const std::string& rubbish :
         {std::string("\r\n\r\n"), std::string("GET\r\n\r\n"),
          std::string("GET /page HTTP/9.9\r\n\r\n"), std::string(100, '\0') + "\r\n\r\n",
          std::string("GET /%ff%00/../../etc HTTP/1.1\r\n\r\n"),
          std::string("GET /page HTTP/1.1\r\nRange: bytes=0-0,0-0,0-0,0-0\r\n\r\n"),
          std::string("GET /page HTTP/1.1\r\nno colon\r\n\r\n")}) {
        CAPTURE(rubbish);
        Connection connection(server.port);
        connection.say(rubbish);
        connection.close_writing();
        CHECK(connection.read_to_end(patience).has_value());
    }
    CHECK(http(server.port, "GET", "/page", patience).body == "words");
}

TEST_CASE("a request of more than request_bytes_max ends its connection") {
    const HttpLimits limits;
    const Running server(limits);
    for (const std::string& opening : // an endless line, and lines without an end
         {std::string("GET /") + std::string(limits.request_bytes_max, 'x'),
          std::string("GET /page HTTP/1.1\r\n") + [&] {
              std::string headers;
              while (headers.size() < limits.request_bytes_max)
                  headers += "A: b\r\n";
              return headers;
          }()}) {
        const Instant begin = net::now();
        Connection connection(server.port);
        connection.say(opening);
        const auto answer = connection.read_to_end(patience);
        REQUIRE(answer.has_value());
        CHECK_FALSE(answer->starts_with("HTTP/1.1 200"));
        CHECK(net::now() - begin < limits.time_max);
    }
    CHECK(http(server.port, "GET", "/page", patience).status == 200);
}

TEST_CASE("a connection has time_max, however its bytes trickle") {
    HttpLimits limits;
    limits.time_max = 300ms;
    const Running server(limits);
    Connection silent(server.port), trickling(server.port);
    const Instant begin = net::now();
    trickling.say("GET /page HTTP/1.1\r\n");
    while (trickling.say("A")) // until it is closed
        (void)silent.read_to_end(10ms);
    CHECK(net::now() - begin >= limits.time_max);
    CHECK(silent.read_to_end(patience).has_value());
    CHECK(http(server.port, "GET", "/page", patience).status == 200);
}

TEST_CASE("of connections beyond connections_max each is told so at once") {
    HttpLimits limits;
    limits.threads = 2;
    limits.connections_max = 5;
    limits.time_max = 1h;
    const Running server(limits);
    std::vector<Connection> held;
    for (std::size_t i = 0; i < limits.connections_max; ++i)
        held.emplace_back(server.port).say("GET /page HTT");
    for (int i = 0; i < 200; ++i)
        CHECK(http(server.port, "GET", "/page", patience).status == 503);
    for (Connection& connection : held)
        connection.say("P/1.1\r\n\r\n");
    for (Connection& connection : held) {
        connection.close_writing();
        const auto answer = connection.read_to_end(patience);
        REQUIRE(answer.has_value());
        CHECK(answer->starts_with("HTTP/1.1 200 "));
    }
}

TEST_CASE("a server ends at once, whoever is connected") {
    HttpLimits limits;
    limits.time_max = 1h;
    std::optional<Running> server(limits);
    std::vector<Connection> held;
    for (std::size_t i = 0; i < limits.connections_max; ++i)
        held.emplace_back(server->port).say("GET /page");
    const Instant begin = net::now();
    server.reset();
    CHECK(net::now() - begin < patience);
    for (Connection& connection : held)
        CHECK(connection.read_to_end(patience).has_value());
}

TEST_CASE("a page that throws is an error of the server, which goes on") {
    HttpServer::Pages pages = one_page();
    pages["/throws"] = []() -> HttpPage { throw std::runtime_error("no luck"); };
    const Running server({}, std::move(pages));
    CHECK(http(server.port, "GET", "/throws", patience).status == 500);
    CHECK(http(server.port, "GET", "/page", patience).status == 200);
}

TEST_CASE("an address that cannot be listened at is said to be") {
    const Running server;
    const std::string taken = "127.0.0.1:" + std::to_string(server.port);
    const auto again = HttpServer::bind("tcp://" + taken, one_page());
    REQUIRE_FALSE(again.has_value());
    CHECK(again.error().code == ErrorCode::io);
    CHECK(again.error().message.find(taken) != std::string::npos);
    CHECK(again.error().message.find("in use") != std::string::npos);

    struct Row {
        const char* text;
        bool insecure;
        std::optional<std::string> want;
    };
    for (const Row& row :
         {Row{"127.0.0.1:0", false, "tcp://127.0.0.1:0"},
          Row{"localhost", false, "tcp://127.0.0.1:50059"},
          Row{"[::1]:80", false, "tcp://[::1]:80"}, Row{"*:0", false, std::nullopt},
          Row{"*:0", true, "tcp://*:0"}, Row{"192.0.2.1:80", false, std::nullopt},
          Row{"ipc:///tmp/x", true, std::nullopt}, Row{"127.0.0.1:port", false, std::nullopt},
          Row{":80", false, std::nullopt}}) {
        CAPTURE(row.text);
        const auto endpoint = http_endpoint(row.text, row.insecure);
        CHECK(endpoint.has_value() == row.want.has_value());
        if (endpoint && row.want)
            CHECK(*endpoint == *row.want);
    }
}
