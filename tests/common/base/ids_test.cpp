#include "common/base/ids.hpp"

#include <doctest/doctest.h>
#include <set>

using namespace fraja;

TEST_CASE("an id survives being written and read") {
    for (int i = 0; i < 100; ++i) {
        const auto id = random_id<JobId>();
        CHECK(parse_id<JobId>(to_string(id)) == id);
    }
}

TEST_CASE("random ids are version 4 and differ") {
    std::set<JobId> seen;
    for (int i = 0; i < 1000; ++i) {
        const auto id = random_id<JobId>();
        CHECK((id.bytes[6] & 0xf0) == 0x40);
        CHECK((id.bytes[8] & 0xc0) == 0x80);
        CHECK(seen.insert(id).second);
    }
}

TEST_CASE("parse_id takes the 36-character form and nothing else") {
    CHECK(parse_id<JobId>("00112233-4455-6677-8899-AABBCCDDEEFF").has_value());
    for (const char* text :
         {"", "0", "00112233-4455-6677-8899-aabbccddeef", "00112233445566778899aabbccddeeff",
          "00112233-4455-6677-8899-aabbccddeefg", "00112233-4455-6677-8899-aabbccddeeff ",
          "001122334-455-6677-8899-aabbccddeeff"}) {
        CAPTURE(text);
        CHECK_FALSE(parse_id<JobId>(text).has_value());
    }
}

TEST_CASE("a content hash is written as 64 hexadecimal digits") {
    ContentHash hash;
    hash.bytes[0] = 0xa5;
    CHECK(to_string(hash) == "a5" + std::string(62, '0'));
}
