#include "client/progress.hpp"

#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::client;
using namespace std::chrono_literals;

namespace {

protocol::JobState running(Duration elapsed, std::uint32_t done, std::uint64_t rays) {
    protocol::JobState state;
    state.job_name = "cone";
    state.number = 17;
    state.phase = protocol::JobPhase::running;
    state.cell_count = 100;
    state.done_count = done;
    state.share_done = done / 100.0;
    state.share_per_s = 0.01;
    state.worker_count = 12;
    state.rays.camera = rays;
    state.elapsed = elapsed;
    return state;
}

} // namespace

TEST_CASE("the progress line is the one of the manual") {
    const ProgressView view{.job = {},
                            .job_name = "cone",
                            .number = 17,
                            .phase = protocol::JobPhase::running,
                            .done_count = 63,
                            .cell_count = 100,
                            .share = 0.63,
                            .worker_count = 12,
                            .rays_per_s = 38.1e6,
                            .elapsed = 42s,
                            .remaining = 25s};
    CHECK(progress_line(view) == "cone #17  63%  12 workers  38.1 Mray/s  0:42 < 0:25");
}

TEST_CASE("the progress line says what is waited for") {
    ProgressView view{.job = {},
                      .job_name = "cone",
                      .number = 1,
                      .phase = protocol::JobPhase::queued,
                      .cell_count = 9,
                      .remaining = {}};
    CHECK(progress_line(view) == "cone #1  0%  waiting for workers  0:00");
    view.connected = false;
    CHECK(progress_line(view) == "cone #1  0%  broker lost, looking for it  0:00");
    view.connected = true;
    view.worker_count = 1;
    CHECK(progress_line(view) == "cone #1  0%  1 worker  0:00");
    view.phase = protocol::JobPhase::done;
    view.share = 1;
    view.worker_count = 0;
    CHECK(progress_line(view) == "cone #1  100%  0:00");
}

TEST_CASE("percent is rounded down: 100 is the end") {
    const auto percent = [](std::uint32_t done, std::uint32_t all) {
        protocol::JobState job;
        job.share_done = all > 0 ? static_cast<double>(done) / all : 0;
        return ProgressView::percent_of(share_done(job));
    };
    CHECK(percent(4'194'303, 4'194'304) == 99);
    CHECK(percent(4'194'304, 4'194'304) == 100);
    CHECK(percent(0, 0) == 0);
    for (std::uint32_t p = 0; p <= 100; ++p)
        CHECK(percent(p, 100) == p);
}

TEST_CASE("a job with a time limit is done by its time, or when there is nothing more to do") {
    protocol::JobState job;
    job.cell_count = 1600, job.done_count = 100;
    job.settings.time_limit = 10s;
    job.phase = protocol::JobPhase::running;
    job.elapsed = 5s;
    CHECK(share_done(job) == 0.5);
    job.done_count = 0; // nobody has come to it
    CHECK(share_done(job) == 0);
    job.in_flight_count = 1;
    CHECK(share_done(job) == 0.5);
    job.elapsed = 11s; // the first pass takes longer
    CHECK(share_done(job) == 0.99);
    job.elapsed = 1s, job.done_count = 1200; // there are not that many samples
    CHECK(share_done(job) == 0.75);
    job.elapsed = 10s, job.done_count = 100, job.phase = protocol::JobPhase::done;
    CHECK(share_done(job) == 1);
}

TEST_CASE("rates have three digits and a prefix") {
    struct Row {
        double rate;
        const char* want;
    };
    for (const Row& row :
         {Row{0, "0 ray/s"}, Row{12.3, "12 ray/s"}, Row{999, "999 ray/s"},
          Row{999.6, "1.00 kray/s"}, Row{1234, "1.23 kray/s"}, Row{99'949, "99.9 kray/s"},
          Row{99'960, "100 kray/s"}, Row{38.1e6, "38.1 Mray/s"}, Row{2.5e9, "2.50 Gray/s"},
          Row{1e18, "1000000 Tray/s"}})
        CHECK(format_rate(row.rate) == row.want);
}

TEST_CASE("speed is that of the last seconds, time left goes by the share that each brings") {
    ProgressMeter meter;
    protocol::JobState at_first = running(0s, 0, 0);
    at_first.share_per_s = 0;
    meter.update(at_first);
    CHECK(meter.view().rays_per_s == 0);
    CHECK_FALSE(meter.view().remaining.has_value());
    for (int s = 1; s <= 20; ++s)
        meter.update(running(std::chrono::seconds(s), static_cast<std::uint32_t>(s),
                             static_cast<std::uint64_t>(s < 10 ? 0 : s - 10) * 1000));
    CHECK(meter.view().rays_per_s == doctest::Approx(1000));
    REQUIRE(meter.view().remaining.has_value());
    CHECK(seconds(*meter.view().remaining) == doctest::Approx(80));

    auto over = running(20s, 100, 10'000);
    over.phase = protocol::JobPhase::done;
    meter.update(over);
    CHECK(meter.view().rays_per_s == doctest::Approx(500)); // of the whole
    CHECK_FALSE(meter.view().remaining.has_value());
}

TEST_CASE("a job that begins anew does not make the speed negative") {
    ProgressMeter meter;
    meter.update(running(50s, 80, 1'000'000));
    meter.update(running(1s, 0, 0));
    CHECK(meter.view().rays_per_s == 0);
    meter.update(running(2s, 1, 500));
    CHECK(meter.view().rays_per_s == doctest::Approx(500));
}

TEST_CASE("off a terminal there is a line per ten percent and one per half minute") {
    PlainPace pace{Instant{}};
    int lines = 0;
    for (int ms = 0; ms < 1000; ++ms) // 100 % in a second
        lines +=
            pace.is_due(Instant{} + std::chrono::milliseconds(ms), static_cast<unsigned>(ms / 10))
                ? 1
                : 0;
    CHECK(lines == 9);
    CHECK(pace.is_due(Instant{} + 1s, 100));
    CHECK_FALSE(pace.is_due(Instant{} + 1s, 100));

    PlainPace slow{Instant{}};
    lines = 0;
    for (int s = 0; s <= 300; ++s)
        lines += slow.is_due(Instant{} + std::chrono::seconds(s), 3) ? 1 : 0;
    CHECK(lines == 10);
}
