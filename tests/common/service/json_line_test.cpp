#include "common/service/json_line.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <nlohmann/json.hpp>

using namespace fraja;
using namespace fraja::service;
using namespace std::chrono_literals;

namespace {

const std::chrono::system_clock::time_point some_time{1'700'000'000'007ms};

} // namespace

TEST_CASE("an event is one object with its time in UTC") {
    const Told told{{LogLevel::warning, "worker_lost", "one", "worker one is gone"}, 3};
    CHECK(json_line(some_time, "fraja-broker", told) ==
          R"({"schema":"fraja.log/1","time":"2023-11-14T22:13:20.007Z","level":"warning",)"
          R"("program":"fraja-broker","event":"worker_lost","subject":"one",)"
          R"("message":"worker one is gone","more":3})");
}

TEST_CASE("what there is not is left out") {
    CHECK(json_line(some_time, "p", {{LogLevel::info, {}, {}, "text"}, 0}) ==
          R"({"schema":"fraja.log/1","time":"2023-11-14T22:13:20.007Z","level":"info",)"
          R"("program":"p","message":"text"})");
}

TEST_CASE("a line is valid JSON in one line whatever the texts hold") {
    for (const std::string& text :
         {std::string("\"quotes\" and \\"), std::string("two\nlines\r\t"), std::string("\0nul", 4),
          std::string("\xff\xfe not UTF-8 \xc3"), std::string("\xe2\x80\xa8 separator"),
          std::string("\x1b[31m"), std::string("ä€😀")}) {
        CAPTURE(text);
        const std::string line = json_line(some_time, "p", {{LogLevel::error, "k", text, text}, 0});
        CHECK(std::ranges::all_of(line, [](char c) { return c >= ' ' && c <= '~'; }));
        const auto object = nlohmann::json::parse(line);
        CHECK(object.at("level") == "error");
        if (text.find('\xff') == std::string::npos)
            CHECK(object.at("message") == text);
    }
}
