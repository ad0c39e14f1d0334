#include "client/page/door.hpp"

#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::client;

namespace {

constexpr const char* token = "0123456789abcdef";

http::Request get(std::string path, std::string host) {
    return {.method = "GET", .path = std::move(path), .query = {}, .host = std::move(host)};
}

int status(const Door& door, const http::Request& request) {
    const auto refused = door.refusal(request);
    return refused ? refused->status : 200;
}

} // namespace

TEST_CASE("on loopback the page is shown to whoever names this machine as itself") {
    const Door door({"127.0.0.1", 50060, true}, "");
    for (const char* host : {"127.0.0.1:50060", "localhost:50060", "127.0.0.1", "[::1]:50060",
                             "localhost:8080"}) // forwarded
        CHECK_MESSAGE(status(door, get("/", host)) == 200, host);
    for (const char* host : {"evil.example", "evil.example:50060", "127.evil.example:50060",
                             "localhost.evil.example", "", "127.0.0.1:50060:evil"})
        CHECK_MESSAGE(status(door, get("/", host)) == 403, host);
}

TEST_CASE("another site's page gets nothing, but may link here") {
    const Door door({"127.0.0.1", 50060, true}, "");
    for (const char* site : {"cross-site", "same-site"}) {
        http::Request request = get("/events", "127.0.0.1:50060");
        request.fetch_site = site;
        CHECK(status(door, request) == 403);
        request.path = "/";
        CHECK(status(door, request) == 200);
        request.method = "POST";
        CHECK(status(door, request) == 403);
    }
    http::Request own = get("/events", "127.0.0.1:50060");
    own.fetch_site = "same-origin";
    CHECK(status(door, own) == 200);
}

TEST_CASE("what changes anything is taken from the page itself alone") {
    const Door door({"127.0.0.1", 50060, true}, "");
    struct Row {
        const char* origin;
        int want;
    };
    for (const Row& row : {Row{"http://127.0.0.1:50060", 200}, Row{"https://127.0.0.1:50060", 200},
                           Row{"http://127.0.0.1:1", 403}, Row{"http://evil.example", 403},
                           Row{"null", 403}, Row{"", 403}}) {
        CAPTURE(row.origin);
        http::Request post = get("/job/x/cancel", "127.0.0.1:50060");
        post.method = "POST";
        post.origin = row.origin;
        CHECK(status(door, post) == row.want);
    }
}

TEST_CASE("off loopback the page wants its token, once in the address and then as a cookie") {
    const Door door({"0.0.0.0", 50060, false}, token);
    CHECK(status(door, get("/", "farm:50060")) == 401);
    CHECK(door.cookie(get("/", "farm:50060")).empty());

    http::Request first = get("/", "farm:50060");
    first.query["token"] = token;
    CHECK(status(door, first) == 200);
    CHECK(door.cookie(first) ==
          "fraja_page_50060=0123456789abcdef; Path=/; HttpOnly; SameSite=Strict");
    first.path = "/events"; // where it would stay in logs
    CHECK(status(door, first) == 401);
    first.path = "/";
    first.query["token"] = "0123456789abcdeF";
    CHECK(status(door, first) == 401);
    CHECK(door.cookie(first).empty());

    struct Row {
        std::string cookies;
        int want;
    };
    for (const Row& row :
         {Row{"fraja_page_50060=0123456789abcdef", 200},
          Row{"a=b; fraja_page_50060=0123456789abcdef; c=d", 200},
          Row{"fraja_page_50060=0123456789abcde", 401},
          Row{"fraja_page_50061=0123456789abcdef", 401}, // another page's
          Row{"xfraja_page_50060=0123456789abcdef", 401}, Row{"fraja_page_50060=", 401},
          Row{"fraja_page_50060", 401}, Row{";;; =;", 401}}) {
        CAPTURE(row.cookies);
        http::Request request = get("/events", "farm:50060");
        request.cookies = row.cookies;
        CHECK(status(door, request) == row.want);
    }
}
