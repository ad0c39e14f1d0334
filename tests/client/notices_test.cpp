#include "client/notices.hpp"

#include "common/net/clock.hpp"
#include "common/net/sockets.hpp"
#include "common/protocol/reasons.hpp"
#include "tests/client/written.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <string>
#include <thread>

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

/// In true time, as others are reached in that.
template <class Notice>
void until_silent(Notice& notice, Instant now) {
    const Instant begin = net::now();
    while (notice.tick(now + (net::now() - begin)) != Instant::never())
        std::this_thread::sleep_for(1ms);
}

} // namespace

TEST_CASE("a broker that is not found at once is looked for aloud, once, in the chosen form") {
    struct Row {
        ProgressMode mode;
        const char* says;
    };
    for (const Row& row :
         {Row{ProgressMode::plain, "fraja-test: looking for a broker at ipc:///a, ipc:///b ...\n"},
          Row{ProgressMode::bar, "\r\x1b[Klooking for a broker at ipc:///a, ipc:///b ..."},
          Row{ProgressMode::json, R"({"schema":"fraja.event/1","event":"looking_for_broker",)"
                                  R"("text":"looking for a broker at ipc:///a, ipc:///b ..."})"
                                  "\n"},
          Row{ProgressMode::none, ""}}) {
        Written written(options);
        SearchNotice notice(written.console, row.mode, {"ipc:///a", "ipc:///b"}, start);
        (void)notice.tick(start + unsaid_max - 1ms);
        CHECK(written.text().empty());
        until_silent(notice, start + unsaid_max);
        CHECK(written.text() == row.says);
    }
}

TEST_CASE("a broker that is found leaves no line behind on a terminal, and none is said later") {
    Written written(options);
    SearchNotice notice(written.console, ProgressMode::bar, {"ipc:///a"}, start);
    until_silent(notice, start + unsaid_max);
    notice.end();
    CHECK(written.text().ends_with("...\r\x1b[K"));

    Written silent(options);
    SearchNotice found(silent.console, ProgressMode::plain, {"ipc:///a"}, start);
    found.end();
    CHECK(found.tick(start + unsaid_max) == Instant::never());
    CHECK(silent.text().empty());
}

TEST_CASE("while a broker is looked for, what hinders is said with it") {
    Written written(options);
    SearchNotice notice(written.console, ProgressMode::plain, {"tcp://127.0.0.1:1", "ipc:///a"},
                        start);
    until_silent(notice, start + unsaid_max);
    CHECK(written.text() == "fraja-test: looking for a broker at tcp://127.0.0.1:1 (nothing "
                            "listens there), ipc:///a ...\n");
}

TEST_CASE(
    "that the broker was lost is said, and whether the same one is found, or another goes on") {
    Written written(options);
    LossNotice notice(written.console);
    notice.update({.connected = true, .broker = "tcp://a:1", .stream = {}});
    CHECK(written.text().empty());
    for (const char* found : {"tcp://a:1", "tcp://b:1"}) {
        notice.update({.connected = false, .broker = "tcp://a:1", .stream = {}});
        notice.update({.connected = true, .broker = found, .stream = {}});
    }
    CHECK(written.text() == "fraja-test: warning: lost the broker at tcp://a:1; looking for it\n"
                            "fraja-test: found the broker at tcp://a:1 again\n"
                            "fraja-test: warning: lost the broker at tcp://a:1; looking for it\n"
                            "fraja-test: goes on with the broker at tcp://b:1\n");
}

TEST_CASE("workers that nobody answers at are named once, and no others") {
    const net::Context context;
    const auto there = net::RouterSocket::bind(context, "tcp://127.0.0.1:0");
    REQUIRE(there.has_value());
    Written written(options);
    AnswerNotice notice(written.console, {there->endpoint(), "tcp://127.0.0.1:1"}, start);
    (void)notice.tick(start + unanswered_max - 1ms);
    CHECK(written.text().empty());
    until_silent(notice, start + unanswered_max);
    CHECK(notice.tick(start + 1h) == Instant::never());
    CHECK(written.text() == "fraja-test: warning: no answer yet from tcp://127.0.0.1:1 (nothing "
                            "listens there)\n");
    AnswerNotice all_there(written.console, {there->endpoint()}, start);
    until_silent(all_there, start + unanswered_max);
    AnswerNotice none(written.console, {}, start);
    CHECK(none.tick(start + 1h) == Instant::never());
    CHECK(std::ranges::count(written.text(), '\n') == 1);
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

TEST_CASE("that fewer brokers keep a job than should is said once, and that all do again") {
    const auto kept = [](std::uint32_t copies) {
        protocol::JobState state = job("");
        state.copies = copies;
        state.copies_wanted = 2;
        return state;
    };
    Written written(options);
    CopiesNotice notice(written.console, ProgressMode::plain);
    notice.update(start, kept(2));
    CHECK(notice.tick(start + 1h) == Instant::never()); // as it should be
    notice.update(start + 1h, kept(0));
    CHECK(notice.tick(start + 1h) == start + 1h + unsaid_max);
    notice.update(start + 1h + 1ms, kept(0));
    (void)notice.tick(start + 1h + unsaid_max);
    (void)notice.tick(start + 2h);
    notice.update(start + 2h, kept(1));
    notice.update(start + 2h, kept(0)); // for too short to be told
    CHECK(notice.tick(start + 3h) == Instant::never());
    notice.update(start + 3h, kept(1));
    (void)notice.tick(start + 4h);
    notice.update(start + 4h, kept(2));
    (void)notice.tick(start + 5h);
    auto over = kept(0);
    over.phase = protocol::JobPhase::done;
    notice.update(start + 5h, over);
    CHECK(notice.tick(start + 6h) == Instant::never());
    CHECK(written.text() ==
          "fraja-test: warning: a single broker of 3 keeps the job: if that one is lost, so is the "
          "job\n"
          "fraja-test: 2 of 3 brokers keep the job\n"
          "fraja-test: all 3 brokers keep the job\n");
}

TEST_CASE("whoever leaves is told at once that fewer brokers keep the job, if not told before") {
    const auto kept = [](std::uint32_t copies) {
        protocol::JobState state = job("");
        state.copies = copies;
        state.copies_wanted = 1;
        return state;
    };
    const std::string words = "fraja-test: warning: a single broker of 2 keeps the job: if that "
                              "one is lost, so is the job\n";
    Written written(options);
    CopiesNotice brief(written.console, ProgressMode::plain);
    brief.update(start, kept(0));
    auto over = kept(0);
    over.phase = protocol::JobPhase::done;
    brief.update(start + unsaid_max / 2, over);
    brief.end();
    CHECK(written.text() == words);
    brief.end();
    CHECK(written.text() == words);

    CopiesNotice mended(written.console, ProgressMode::plain),
        told(written.console, ProgressMode::plain),
        never_lacked(written.console, ProgressMode::plain);
    mended.update(start, kept(0));
    mended.update(start + unsaid_max / 2, kept(1));
    mended.end();
    never_lacked.update(start, kept(1));
    never_lacked.end();
    CHECK(written.text() == words);
    told.update(start, kept(0));
    (void)told.tick(start + unsaid_max);
    told.end();
    CHECK(written.text() == words + words);
}

TEST_CASE("with --progress none it is said only where a single broker keeps a job") {
    Written written(options);
    CopiesNotice notice(written.console, ProgressMode::none);
    protocol::JobState state = job("");
    for (const std::uint32_t copies : {1u, 2u, 0u}) {
        state.copies = copies;
        state.copies_wanted = 2;
        notice.update(start, state);
        (void)notice.tick(start + unsaid_max);
    }
    CHECK(written.text().starts_with("fraja-test: warning: a single broker of 3"));
    CHECK(std::ranges::count(written.text(), '\n') == 1);
    Written alone(options);
    CopiesNotice none(alone.console, ProgressMode::plain);
    none.update(start, job(""));
    CHECK(none.tick(start + 1h) == Instant::never());
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
