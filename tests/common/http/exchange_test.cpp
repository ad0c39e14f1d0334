#include "common/http/exchange.hpp"

#include "tests/support/seeds.hpp"

#include <doctest/doctest.h>
#include <stdexcept>
#include <string>

using namespace fraja;
using namespace fraja::http;

namespace {

struct Silence final : LineSource {
    std::string next(Instant) override { return {}; }
};

Answer answered(const Request& request) {
    if (request.path == "/lines")
        return {.type = "application/x-ndjson", .lines = std::make_shared<Silence>()};
    if (request.path == "/throws")
        throw std::runtime_error("no luck");
    if (request.path == "/refused") {
        Answer refused = refusal(405, "no");
        refused.allow = "GET";
        refused.retry_after_s = 7;
        return refused;
    }
    return {.type = "text/html",
            .body = body(request.method + " " + request.path + " " + request.host + " " +
                         request.origin + " " + request.fetch_site + " " + request.cookies + " " +
                         (request.query.contains("a") ? request.query.at("a") : "-")),
            .caching = "no-cache",
            .cookie = "c=d"};
}

Reply ask(const std::string& request) {
    return exchange(request, answered, {{"X-Always", "here"}});
}

bool says(const Reply& reply, std::string_view text) {
    return reply.head->find(text) != std::string::npos;
}

} // namespace

TEST_CASE("a request arrives as it was sent, and its answer says all that it is to say") {
    const Reply reply = ask("GET /x?a=b%20c HTTP/1.1\r\nHost: h:1\r\nOrigin: http://o\r\n"
                            "Sec-Fetch-Site: none\r\nCookie: k=v\r\n\r\n");
    REQUIRE(reply.body);
    CHECK(*reply.body == "GET /x h:1 http://o none k=v b c");
    CHECK(reply.keeps);
    for (const char* line :
         {"HTTP/1.1 200 OK\r\n", "Content-Type: text/html\r\n", "Content-Length: 32\r\n",
          "Cache-Control: no-cache\r\n", "Set-Cookie: c=d\r\n", "X-Always: here\r\n"})
        CHECK_MESSAGE(says(reply, line), line);
    for (const char* untrue : {"Keep-Alive", "Connection", "Accept-Ranges", "Allow", "Retry-After"})
        CHECK_FALSE_MESSAGE(says(reply, untrue), untrue);
    CHECK(reply.head->ends_with("\r\n\r\n"));

    const Reply refused = ask("GET /refused HTTP/1.1\r\n\r\n");
    CHECK(says(refused, "HTTP/1.1 405 "));
    CHECK(says(refused, "Allow: GET\r\n"));
    CHECK(says(refused, "Retry-After: 7\r\n"));
    CHECK(*refused.body == "no\n");
}

TEST_CASE("HEAD is told what GET would be, and nothing more") {
    const Reply got = ask("GET /x HTTP/1.1\r\n\r\n"), told = ask("HEAD /x HTTP/1.1\r\n\r\n");
    CHECK(says(told, "Content-Length: " + std::to_string(got.body->size() + 1))); // of its method
    CHECK_FALSE(says(told, "Accept-Ranges"));
    CHECK(told.body == nullptr);
    CHECK(told.keeps);
    CHECK(ask("HEAD /lines HTTP/1.1\r\n\r\n").lines == nullptr);
}

TEST_CASE("lines have no length, and end with the connection") {
    const Reply reply = ask("GET /lines HTTP/1.1\r\n\r\n");
    CHECK(reply.lines != nullptr);
    CHECK_FALSE(reply.keeps);
    CHECK(says(reply, "Content-Type: application/x-ndjson\r\n"));
    CHECK(says(reply, "Connection: close\r\n"));
    CHECK_FALSE(says(reply, "Content-Length"));
    CHECK(reply.head->ends_with("\r\n\r\n"));
}

TEST_CASE("a connection is kept unless the other end, or its protocol, does not want that") {
    CHECK_FALSE(ask("GET /x HTTP/1.1\r\nConnection: close\r\n\r\n").keeps);
    const Reply old = ask("GET /x HTTP/1.0\r\n\r\n");
    CHECK_FALSE(old.keeps);
    CHECK(says(old, "Connection: close\r\n"));
}

TEST_CASE("a request with a body is refused, and not asked to send it") {
    for (const std::string headers :
         {"Content-Length: 5\r\n", "Content-Length: 0\r\nContent-Length: 5\r\n",
          "Content-Length: -\r\n", "Transfer-Encoding: chunked\r\n",
          "Expect: 100-continue\r\nContent-Length: 5\r\n"}) {
        CAPTURE(headers);
        const Reply reply = ask("POST /x HTTP/1.1\r\n" + headers + "\r\n");
        CHECK(reply.head->starts_with("HTTP/1.1 413 "));
        CHECK(says(reply, "Connection: close\r\n"));
        CHECK_FALSE(reply.keeps);
        CHECK(reply.head->find("HTTP/1.1", 1) == std::string::npos);
    }
    CHECK(says(ask("POST /x HTTP/1.1\r\nContent-Length: 0\r\n\r\n"), " 200 "));
}

TEST_CASE("rubbish is told so") {
    const std::size_t bytes_max = Limits().request_bytes_max;
    for (const std::string& rubbish :
         {std::string("\r\n\r\n"), std::string("GET\r\n\r\n"),
          std::string("GET /x HTTP/9.9\r\n\r\n"), std::string(100, '\0') + "\r\n\r\n",
          "GET /x HTTP/1.1\r\nRange: bytes=" + std::string(bytes_max - 100, '1') + "-\r\n\r\n",
          std::string("GET /x HTTP/1.1\r\nRange: bytes=5-1\r\n\r\n")}) {
        CAPTURE(rubbish.substr(0, 50));
        const Reply reply = ask(rubbish);
        REQUIRE(reply.head);
        CHECK(reply.head->starts_with("HTTP/1.1 4"));
        CHECK(says(reply, "X-Always: here\r\n"));
        CHECK(says(reply, "Connection: close\r\n"));
        CHECK_FALSE(reply.keeps);
        REQUIRE(reply.body);
        CHECK(says(reply, "Content-Length: " + std::to_string(reply.body->size()) + "\r\n"));
    }
    std::string ranges = "bytes=0-0";
    while (ranges.size() < bytes_max - 100)
        ranges += ",0-0";
    CHECK(says(ask("GET /x HTTP/1.1\r\nRange: " + ranges + "\r\n\r\n"), " 200 ")); // all of it
    CHECK(says(ask("GET /%ff%00/../../etc HTTP/1.1\r\nno colon\r\n\r\n"), " 200 "));
}

TEST_CASE("whatever is sent, one reply comes of it") {
    const std::string request = "POST /x?a=b%20c HTTP/1.1\r\nHost: h:1\r\nContent-Length: 0\r\n"
                                "Connection: close\r\nRange: bytes=0-5\r\nCookie: k=v\r\n\r\n";
    for_each_seed(2'000, [&](Rng& rng) {
        std::string sent = request;
        for (std::uint64_t changes = 1 + rng.below(8); changes > 0; --changes) {
            const std::size_t at = rng.below(sent.size());
            if (rng.below(2) == 0)
                sent[at] = static_cast<char>(rng.next());
            else
                sent.erase(at, 1);
        }
        const Reply reply = ask(sent);
        REQUIRE(reply.head);
        CHECK(reply.head->starts_with("HTTP/1.1 "));
        CHECK(reply.head->ends_with("\r\n\r\n"));
        CHECK(reply.head->find("HTTP/1.1 ", 1) == std::string::npos);
        CHECK(says(reply, "X-Always: here\r\n"));
    });
}

TEST_CASE("an answerer that throws is an error of the server") {
    const Reply reply = ask("GET /throws HTTP/1.1\r\n\r\n");
    CHECK(says(reply, "HTTP/1.1 500 "));
    CHECK(*reply.body == "This failed: no luck\n");
}

TEST_CASE("what is refused without asking has the headers of every answer, and names the limit") {
    const Limits limits{.connections_max = 11,
                        .streams_max = 12,
                        .request_line_bytes_max = 13,
                        .request_bytes_max = 14};
    const Refusals all = refusals(limits, {{"X-Always", "here"}});
    struct Row {
        const Reply& reply;
        const char *status, *names;
    };
    for (const Row& row :
         {Row{all.line_too_long, "414", "13"}, Row{all.request_too_large, "431", "14"},
          Row{all.too_late, "408", "in time"}, Row{all.no_room, "503", "11"},
          Row{all.streams_full, "503", "12"}}) {
        CHECK(row.reply.head->starts_with(std::string("HTTP/1.1 ") + row.status));
        CHECK(says(row.reply, "X-Always: here\r\n"));
        CHECK(row.reply.body->find(row.names) != std::string::npos);
        CHECK(says(row.reply, "Retry-After") == (row.status == std::string_view("503")));
        CHECK_FALSE(row.reply.keeps);
    }
}
