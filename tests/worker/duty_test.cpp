#include "worker/duty.hpp"

#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::worker;
using namespace std::chrono_literals;
using enum Duty::Verdict;

namespace {

constexpr Load idle{false, 0};

/// What is said at each second, of a load that is asked for; stops where it is not go_on.
template <class LoadAt>
std::pair<int, Duty::Verdict> first_verdict(const DutyTerms& terms, LoadAt&& load_at) {
    Duty duty(terms);
    for (int second = 0; second < 1'000; ++second)
        if (const auto verdict = duty.judge(Instant{second * 1s}, load_at(second), 0);
            verdict != go_on)
            return {second, verdict};
    return {1'000, go_on};
}

} // namespace

TEST_CASE("hours are read as they are written, and nothing else") {
    CHECK(parse_hours("20:00-08:30") == Hours{1'200, 510});
    CHECK(parse_hours("0:00-23:59") == Hours{0, 1'439});
    for (const char* text : {"", "20:00", "20-08", "24:00-08:00", "20:60-08:00", "20:00-20:00",
                             "20:00-08:00 ", "20:0-8:00", "-1:00-08:00", "20:00–08:00"}) {
        CAPTURE(text);
        CHECK_FALSE(parse_hours(text).has_value());
    }
    CHECK(time_of_day(510) == "08:30");
    CHECK(minute_now() < 1'440);
}

TEST_CASE("hours may go over midnight, and end before their last minute") {
    const Hours night{1'200, 480}, day{480, 1'200};
    for (std::uint32_t minute = 0; minute < 1'440; ++minute) {
        CAPTURE(minute);
        CHECK(night.contains(minute) == (minute >= 1'200 || minute < 480));
        CHECK(day.contains(minute) != night.contains(minute));
    }
}

TEST_CASE("without terms a worker serves for ever") {
    CHECK(first_verdict({}, [](int) { return idle; }) == std::pair{1'000, go_on});
}

TEST_CASE("a worker has served enough when it was idle for long, not before") {
    const DutyTerms terms{.idle_exit = 60s};
    CHECK(first_verdict(terms, [](int) { return idle; }) == std::pair{60, enough});
    // A tile that takes long is work, and so is one that came and went between two looks.
    CHECK(first_verdict(terms, [](int s) { return Load{s < 100, 0}; }) == std::pair{160, enough});
    CHECK(first_verdict(terms, [](int s) {
              return Load{false, s < 100 ? 0u : 1u};
          }) == std::pair{60, enough});
    CHECK(first_verdict(terms, [](int s) {
              return Load{false, s < 50 ? 0u : 1u};
          }) == std::pair{111, enough});
}

TEST_CASE("once is enough when the first work is over, and nothing without any") {
    const DutyTerms terms{.idle_exit = {}, .once = true};
    CHECK(first_verdict(terms, [](int) { return idle; }) == std::pair{1'000, go_on});
    CHECK(first_verdict(terms, [](int s) {
              return Load{s < 100, s < 50 ? 0u : 7u};
          }) == std::pair{105, enough});
}

TEST_CASE("a worker that grew beyond its limit is to be started again") {
    Duty duty({.idle_exit = {}, .once = false, .memory_max = 1'000});
    CHECK(duty.judge({}, {true, 0}, 1'000) == go_on);
    CHECK(duty.judge({}, {true, 0}, 1'001) == too_large);
}

TEST_CASE(
    "a worker has the memory that it allows itself, within what its control groups let it have") {
    constexpr std::uint64_t mib = 1 << 20;
    const GroupLimit group{512.0 * mib, "/groups/memory.max"};
    CHECK(memory_share(0, {}) == MemoryShare{});
    CHECK(memory_share(64 * mib, {}) == MemoryShare{64 * mib, {}});
    CHECK(memory_share(0, group) == MemoryShare{512 * mib, {}});
    CHECK(memory_share(511 * mib, group) == MemoryShare{511 * mib, {}});
    for (const std::uint64_t own : {512 * mib, 4096 * mib}) {
        const MemoryShare share = memory_share(own, group);
        CHECK(share.bytes == 512 * mib);
        CHECK(share.warning.find("/groups/memory.max lets it have 512 MiB") != std::string::npos);
    }
}
