#include "common/discovery/source.hpp"

#include <doctest/doctest.h>
#include <string>
#include <string_view>

using namespace fraja;
using namespace fraja::discovery;

TEST_CASE("broker_word makes endpoints, auto and the names of SRV records whole") {
    struct Row {
        std::string_view text, want;
    };
    for (const Row& row : {
             Row{"auto", "auto"},
             {"srv:example.org", "srv:_fraja._tcp.example.org"},
             {"srv:example.org.", "srv:_fraja._tcp.example.org"},
             {"srv:_render._tcp.farm", "srv:_render._tcp.farm"},
             {"host", "tcp://host:50057"},
             {"tcp://host:7", "tcp://host:7"},
             {"automatic", "tcp://automatic:50057"},
         }) {
        CAPTURE(row.text);
        const auto word = broker_word(row.text);
        REQUIRE(word);
        CHECK(*word == row.want);
        CHECK(is_source(*word) == !row.want.starts_with("tcp:"));
    }
    CHECK(srv_name("srv:_fraja._tcp.example.org") == "_fraja._tcp.example.org");
}

TEST_CASE("broker_word refuses names that the DNS cannot know") {
    const std::string label(63, 'a');
    CHECK(broker_word("srv:" + label));
    for (const std::string& text :
         {std::string("srv:"), std::string("srv:."), std::string("srv:a..b"),
          std::string("srv:a b"), std::string("srv:host:50057"), std::string("srv:-\n"),
          "srv:" + label + "a", "srv:" + label + "." + label + "." + label + "." + label,
          std::string("tcp://*:1"), std::string("udp://h:1")}) {
        CAPTURE(text);
        const auto word = broker_word(text);
        REQUIRE_FALSE(word);
        CHECK(word.error().code == ErrorCode::invalid_argument);
        CHECK(word.error().message.find('\n') == std::string::npos);
    }
}
