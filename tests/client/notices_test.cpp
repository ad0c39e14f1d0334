#include "client/notices.hpp"

#include "common/protocol/reasons.hpp"
#include "tests/client/written.hpp"

#include <doctest/doctest.h>
#include <string>

using namespace fraja;
using namespace fraja::client;
using namespace std::chrono_literals;

namespace {

constexpr Instant start{};
const ConsoleOptions options = {.program = "fraja-test"};

protocol::JobState job(std::string_view reason) {
    protocol::JobState state;
    state.job_name = "cone";
    state.number = 17;
    state.phase = protocol::JobPhase::queued;
    state.reason = reason;
    return state;
}

} // namespace

TEST_CASE("a broker that is not found at once is looked for aloud, once, in the chosen form") {
    struct Row {
        ProgressMode mode;
        const char* says;
    };
    for (const Row& row :
         {Row{ProgressMode::plain, "fraja-test: looking for a broker at a:1, b:2 ...\n"},
          Row{ProgressMode::bar, "\r\x1b[Klooking for a broker at a:1, b:2 ..."},
          Row{ProgressMode::json, R"({"schema":"fraja.event/1","event":"looking_for_broker",)"
                                  R"("text":"looking for a broker at a:1, b:2 ..."})"
                                  "\n"},
          Row{ProgressMode::none, ""}}) {
        Written written(options);
        SearchNotice notice(written.console, row.mode, {"a:1", "b:2"}, start);
        (void)notice.tick(start + unsaid_max - 1ms);
        CHECK(written.text().empty());
        (void)notice.tick(start + unsaid_max);
        CHECK(notice.tick(start + 2 * unsaid_max) == Instant::never());
        CHECK(written.text() == row.says);
    }
}

TEST_CASE("a broker that is found leaves no line behind on a terminal, and none is said later") {
    Written written(options);
    SearchNotice notice(written.console, ProgressMode::bar, {"a:1"}, start);
    (void)notice.tick(start + unsaid_max);
    notice.end();
    CHECK(written.text().ends_with("...\r\x1b[K"));

    Written silent(options);
    SearchNotice found(silent.console, ProgressMode::plain, {"a:1"}, start);
    found.end();
    CHECK(found.tick(start + unsaid_max) == Instant::never());
    CHECK(silent.text().empty());
}

TEST_CASE("why a job waits is said once, with the cure, and that it goes on") {
    Written written(options);
    WaitNotice notice(written.console, ProgressMode::plain);
    for (int i = 0; i < 3; ++i)
        notice.update(start, job(protocol::no_worker_reason), "do this");
    CHECK(notice.tick(start) == start + unsaid_max);
    (void)notice.tick(start + unsaid_max);
    notice.update(start + 2s, job(protocol::no_worker_reason), "do this");
    (void)notice.tick(start + 5s);
    notice.update(start + 6s, job(""), "do this");
    (void)notice.tick(start + 9s);
    CHECK(written.text() == "fraja-test: cone #17 is waiting: no worker is connected; do this\n"
                            "fraja-test: a worker is here: cone #17 goes on\n");
}

TEST_CASE("that a job is paused is said, with what lets it go on, and that it does") {
    Written written(options);
    WaitNotice notice(written.console, ProgressMode::plain);
    protocol::JobState paused = job("");
    paused.phase = protocol::JobPhase::paused;
    notice.update(start, paused, "do this");
    (void)notice.tick(start + unsaid_max);
    notice.update(start + 2s, job(""), "do this");
    CHECK(written.text() ==
          "fraja-test: cone #17 is paused (fraja-ctl resume '#17' lets it go on)\n"
          "fraja-test: cone #17 goes on\n");
}

TEST_CASE("of a short wait, of a job that is over, and where none is wanted nothing is said") {
    Written written(options);
    WaitNotice notice(written.console, ProgressMode::plain);
    notice.update(start, job(protocol::no_worker_reason), "do this");
    notice.update(start + unsaid_max / 2, job(""), "do this");
    auto failed = job("no luck");
    failed.phase = protocol::JobPhase::failed;
    notice.update(start + 1s, failed, "do this");
    CHECK(notice.tick(start + 1h) == Instant::never());
    WaitNotice none(written.console, ProgressMode::none);
    none.update(start, job(protocol::no_worker_reason), "do this");
    CHECK(none.tick(start + 1h) == Instant::never());
    CHECK(written.text().empty());
}

TEST_CASE("what is resumed is said with what was there, and that nothing was") {
    Written written(options);
    auto state = job("");
    state.job = JobId{.bytes = {1}};
    state.share_done = 0.63;
    tell_resumed(written.console, ProgressMode::plain, state, JobId{.bytes = {2}});
    tell_resumed(written.console, ProgressMode::plain, state, state.job);
    CHECK(written.text() == "fraja-test: resumes cone #17: 63% of it was there\n"
                            "fraja-test: no job of this scene and these settings to resume: cone "
                            "#17 is new\n");
}
