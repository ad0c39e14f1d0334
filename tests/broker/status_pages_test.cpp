#include "broker/status_pages.hpp"

#include <doctest/doctest.h>
#include <optional>

using namespace fraja;
using namespace fraja::broker;

TEST_CASE("pages are answered to GET and HEAD, and the rest is told what there is") {
    const Board board;
    const http::Answerer pages = status_pages(board, {});
    for (const char* method : {"GET", "HEAD"}) {
        const http::Answer metrics = pages({method, "/metrics"});
        CHECK(metrics.status == 200);
        CHECK(metrics.type.starts_with("text/plain; version="));
        CHECK(metrics.body->find("fraja_broker_") != std::string::npos);
        CHECK(pages({method, "/healthz"}).type == "application/json");
        const http::Answer nothing = pages({method, "/pages"});
        CHECK(nothing.status == 404);
        CHECK(nothing.body->find("there is /healthz /livez /metrics") != std::string::npos);
    }
    for (const char* method : {"POST", "PUT", "DELETE", "OPTIONS", "PATCH"}) {
        CAPTURE(method);
        const http::Answer refused = pages({method, "/metrics"});
        CHECK(refused.status == 405);
        CHECK(refused.allow == "GET, HEAD");
    }
}

TEST_CASE("pages are served at ADDR:PORT, off loopback only where that is said to be wanted") {
    struct Row {
        const char* text;
        bool insecure;
        std::optional<http::Address> want;
    };
    for (const Row& row :
         {Row{"127.0.0.1:0", false, {{"127.0.0.1", 0}}},
          Row{"localhost", false, {{"127.0.0.1", 50059}}}, Row{"[::1]:80", false, {{"::1", 80}}},
          Row{"*:0", false, std::nullopt}, Row{"*:0", true, {{"0.0.0.0", 0}}},
          Row{"192.0.2.1:80", false, std::nullopt}, Row{"ipc:///tmp/x", true, std::nullopt},
          Row{"127.0.0.1:port", false, std::nullopt}, Row{":80", false, std::nullopt}}) {
        CAPTURE(row.text);
        const auto address = status_address(row.text, row.insecure);
        CHECK(address.has_value() == row.want.has_value());
        if (address && row.want)
            CHECK(*address == *row.want);
    }
}
