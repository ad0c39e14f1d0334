#include "common/service/repeats.hpp"

#include <algorithm>
#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::service;
using namespace std::chrono_literals;

namespace {

LogLine event(std::string_view kind, std::string subject = {}, std::string text = "text") {
    return {LogLevel::warning, kind, std::move(subject), std::move(text)};
}

/// The time of tests, and how many lines are told.
class Log {
public:
    void say(const LogLine& line) { lines += repeats.take(now, line).has_value(); }
    /// As loops do, every second.
    void pass(Duration time) {
        for (const Instant end = now + time; now < end; now = now + 1s)
            for (const Told& told : repeats.due(now)) {
                ++lines;
                last = told;
            }
    }

    RepeatLimits limits;
    Repeats repeats{limits};
    Instant now{1h};
    std::size_t lines = 0;
    Told last;
};

} // namespace

TEST_CASE("the first events of a kind are told at once, the others are counted") {
    Log log;
    for (int i = 0; i < 1000; ++i)
        log.say(event("rubbish"));
    CHECK(log.lines == log.limits.subject.burst);
    log.say(event("another kind"));
    CHECK(log.lines == log.limits.subject.burst + 1);
}

TEST_CASE("what was counted is told in time, once, with the last of them") {
    Log log;
    for (int i = 0; i < 12; ++i)
        log.say(event("rubbish", "", "number " + std::to_string(i)));
    log.lines = 0;
    log.pass(1min);
    CHECK(log.lines == 1);
    CHECK(log.last.line.text == "number 11");
    CHECK(log.last.more == 12 - log.limits.subject.burst - 1);
}

TEST_CASE("a flood that goes on is one line in each interval") {
    Log log;
    for (int second = 0; second < 600; ++second) {
        for (int i = 0; i < 1000; ++i)
            log.say(event("rubbish"));
        log.pass(1s);
    }
    CHECK(log.lines <= log.limits.subject.burst + 600 / 10 + 1);
    CHECK(log.lines >= 600 / 10);
}

TEST_CASE("an event that comes when the time for a line is up brings what was counted before it") {
    Log log;
    for (int i = 0; i < 20; ++i)
        log.say(event("rubbish"));
    log.now = log.now + 1min;
    const auto told = log.repeats.take(log.now, event("rubbish", "", "new"));
    REQUIRE(told.has_value());
    CHECK(told->line.text == "new");
    CHECK(told->more == 20 - log.limits.subject.burst);
    CHECK(log.repeats.due(log.now + 1h).empty());
}

TEST_CASE("a flapping worker is counted, and the others are still told") {
    Log log;
    for (int i = 0; i < 100; ++i)
        log.say(event("worker_lost", "flapping"));
    const std::size_t before = log.lines;
    for (int i = 0; i < 1000; ++i)
        log.say(event("worker_lost", "worker " + std::to_string(i)));
    CHECK(log.lines == before + 1000);
}

TEST_CASE("ever new subjects are told as those of one farm, and then counted with their kind") {
    Log log;
    std::size_t most = 0;
    for (int second = 0; second < 300; ++second) {
        for (int i = 0; i < 1000; ++i)
            log.say(event("worker_here", std::to_string(second) + "/" + std::to_string(i)));
        log.pass(1s);
        most = std::max(most, log.repeats.subject_count());
    }
    CHECK(log.lines >= log.limits.kind.burst);
    CHECK(log.lines <= log.limits.kind.burst + 300 + 1);
    CHECK(most <= log.limits.kind.burst + 300);
}

TEST_CASE("who has been quiet is forgotten, and starts anew") {
    Log log;
    for (int i = 0; i < 50; ++i)
        log.say(event("worker_lost", "flapping"));
    log.pass(5min);
    CHECK(log.repeats.subject_count() == 0);
    log.lines = 0;
    for (int i = 0; i < 50; ++i)
        log.say(event("worker_lost", "flapping"));
    CHECK(log.lines == log.limits.subject.burst);
}

TEST_CASE("what has no kind is always told, and nothing that was counted is lost in the end") {
    Log log;
    for (int i = 0; i < 100; ++i)
        log.say(event(""));
    CHECK(log.lines == 100);
    for (int i = 0; i < 100; ++i)
        log.say(event("rubbish"));
    const auto rest = log.repeats.rest();
    REQUIRE(rest.size() == 1);
    CHECK(rest[0].more == 100 - log.limits.subject.burst - 1);
    CHECK(log.repeats.rest().empty());
}

TEST_CASE("what was asked for to find a fault is told when it happens, each") {
    Log log;
    for (int i = 0; i < 1000; ++i)
        log.say({LogLevel::debug, "tile_done", "a worker", "text"});
    CHECK(log.lines == 1000);
    log.pass(1min);
    CHECK(log.lines == 1000);
}
