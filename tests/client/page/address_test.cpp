#include "client/page/address.hpp"

#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::client;

TEST_CASE("the page is served at ADDR:PORT, and on loopback unless told otherwise") {
    struct Row {
        std::string_view text;
        PageAddress want;
    };
    for (const Row& row :
         {Row{"", {"127.0.0.1", 50060, true}}, Row{"127.0.0.1:0", {"127.0.0.1", 0, true}},
          Row{"localhost:80", {"localhost", 80, true}}, Row{"[::1]:80", {"::1", 80, true}},
          Row{"*:80", {"0.0.0.0", 80, false}}, Row{"10.1.2.3:80", {"10.1.2.3", 80, false}},
          Row{"127.evil.example:80", {"127.evil.example", 80, false}}}) {
        CAPTURE(row.text);
        const auto address = parse_page_address(row.text);
        REQUIRE(address);
        CHECK(*address == row.want);
    }
    for (const std::string_view bad :
         {"cone", "50060", ":80", "127.0.0.1:", "127.0.0.1:65536", "ipc://somewhere:1", "a b:80"}) {
        CAPTURE(bad);
        const auto address = parse_page_address(bad);
        REQUIRE_FALSE(address);
        CHECK(address.error().message.find("a JOB goes before --serve") != std::string::npos);
    }
}

TEST_CASE("the page's address is one that a browser opens") {
    CHECK(page_url({"127.0.0.1", 80, true}, "ada", "") == "http://127.0.0.1:80/");
    CHECK(page_url({"::1", 80, true}, "ada", "") == "http://[::1]:80/");
    CHECK(page_url({"0.0.0.0", 80, false}, "ada", "abc") == "http://ada:80/?token=abc");
}
