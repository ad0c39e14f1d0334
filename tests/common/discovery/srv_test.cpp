#include "common/discovery/srv.hpp"

#include "common/base/bytes.hpp"
#include "tests/support/dns_server.hpp"
#include "tests/support/seeds.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <map>
#include <string>
#include <vector>

using namespace fraja;
using namespace fraja::discovery;

namespace {

using Endpoints = std::vector<std::string>;

/// Of a name server, with a compressed name in the question and records of three priorities.
Bytes stored_answer() {
    constexpr unsigned char bytes[] = {
        0x4a, 0x11, 0x81, 0x80, 0x00, 0x01, 0x00, 0x02, 0x00, 0x00, 0x00, 0x00, // header
        0x06, '_',  'f',  'r',  'a',  'j',  'a',  0x04, '_',  't',  'c',  'p',  // question
        0x04, 'f',  'a',  'r',  'm',  0x00, 0x00, 0x21, 0x00, 0x01,             //
        0xc0, 0x0c, 0x00, 0x21, 0x00, 0x01, 0x00, 0x00, 0x0e, 0x10, 0x00, 0x0c, // answer 1
        0x00, 0x0a, 0x00, 0x05, 0xc3, 0x89, 0x01, 'a',  0x02, 'e',  'x',  0x00, // a.ex
        0xc0, 0x0c, 0x00, 0x21, 0x00, 0x01, 0x00, 0x00, 0x0e, 0x10, 0x00, 0x0c, // answer 2
        0x00, 0x14, 0x00, 0x00, 0x00, 0x07, 0x01, 'b',  0x02, 'e',  'x',  0x00, // b.ex
    };
    Bytes all;
    for (const unsigned char byte : bytes)
        all.push_back(static_cast<std::byte>(byte));
    return all;
}

} // namespace

TEST_CASE("parse_srv_answer reads what a name server has sent") {
    const auto records = parse_srv_answer(stored_answer());
    REQUIRE(records);
    CHECK(*records == std::vector<SrvRecord>{{10, 5, 50057, "a.ex"}, {20, 0, 7, "b.ex"}});
}

TEST_CASE("parse_srv_answer tells why there are no records") {
    const Bytes question = srv_question("_fraja._tcp.farm");
    const auto none = parse_srv_answer(dns_answer(question, {}, true));
    REQUIRE_FALSE(none);
    CHECK(none.error() == Error{ErrorCode::not_found, "the name has no SRV records"});
    const auto refused =
        parse_srv_answer(dns_answer(question, {.records = {{0, 0, 1, "."}}}, true));
    REQUIRE_FALSE(refused);
    CHECK(refused.error() ==
          Error{ErrorCode::not_found, "the DNS says that there is no such service"});
    const auto rubbish = parse_srv_answer(to_bytes("rubbish"));
    REQUIRE_FALSE(rubbish);
    CHECK(rubbish.error().code == ErrorCode::malformed_frame);
}

TEST_CASE("parse_srv_answer takes any bytes") {
    const Bytes good = stored_answer();
    for (std::size_t size = 0; size < good.size(); ++size)
        (void)parse_srv_answer(std::span(good).first(size));
    for_each_seed(2'000, [&](Rng& rng) {
        Bytes bytes = good;
        for (std::uint64_t i = 1 + rng.below(8); i > 0; --i)
            bytes[rng.below(bytes.size())] = static_cast<std::byte>(rng.below(256));
        if (const auto records = parse_srv_answer(bytes))
            for (const std::string& endpoint : endpoints_in_order(*records, rng))
                CHECK(std::ranges::all_of(endpoint, [](char c) { return c > ' ' && c <= '~'; }));
    });
}

TEST_CASE("endpoints are tried by priority, and those that lead nowhere not at all") {
    Rng rng(1);
    CHECK(endpoints_in_order({{30, 0, 3, "c"},
                              {10, 0, 1, "a"},
                              {10, 0, 0, "no-port"},
                              {20, 9, 2, "b"},
                              {20, 9, 2, "no host"},
                              {20, 9, 2, ""},
                              {40, 0, 1, "a"}}, // named already
                             rng) == Endpoints{"tcp://a:1", "tcp://b:2", "tcp://c:3"});
    CHECK(endpoints_in_order({}, rng).empty());
}

TEST_CASE("among equals the first is drawn by weight, and all are there") {
    std::map<std::string, int> first;
    constexpr int rounds = 10'000;
    Rng rng(7);
    for (int i = 0; i < rounds; ++i) {
        const auto order = endpoints_in_order(
            {{0, 60, 1, "a"}, {0, 30, 1, "b"}, {0, 0, 1, "never"}, {0, 9, 1, "c"}}, rng);
        REQUIRE(order.size() == 4);
        ++first[order.front()];
    }
    // RFC 2782: of the numbers 0 to 99 one is the weightless record's.
    CHECK(first["tcp://a:1"] == doctest::Approx(rounds * .60).epsilon(.05));
    CHECK(first["tcp://b:1"] == doctest::Approx(rounds * .30).epsilon(.08));
    CHECK(first["tcp://c:1"] == doctest::Approx(rounds * .09).epsilon(.15));
    CHECK(first["tcp://never:1"] == doctest::Approx(rounds * .01).epsilon(.4));
}

TEST_CASE("weights may be as large as they can, and records as many as they like") {
    std::vector<SrvRecord> records;
    for (int i = 0; i < 1000; ++i)
        records.push_back({static_cast<std::uint16_t>(i / 100), 65535, 1, "h" + std::to_string(i)});
    Rng rng(3);
    const auto order = endpoints_in_order(records, rng);
    CHECK(order.size() == srv_records_max);
    CHECK(std::ranges::all_of(order, [](const std::string& e) { // of the first hundred
        return e.size() <= std::string("tcp://h99:1").size();
    }));
}
