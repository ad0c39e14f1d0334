#include "client/columns.hpp"
#include "client/farm_screen.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <fmt/core.h>

using namespace fraja;
using namespace fraja::client;

namespace {

FarmView farm(std::uint32_t jobs, std::uint32_t workers) {
    FarmView view{"tcp://127.0.0.1:50057", true, true, {}};
    view.farm.broker.program_version = "0.1.0";
    view.farm.broker.uptime = std::chrono::minutes(90);
    for (std::uint32_t i = 1; i <= jobs; ++i) {
        protocol::JobState job;
        job.number = i;
        job.job_name = fmt::format("job-{}", i);
        job.phase = protocol::JobPhase::done;
        view.farm.jobs.push_back(job);
    }
    for (std::uint32_t i = 1; i <= workers; ++i) {
        protocol::WorkerState worker;
        worker.worker_name = fmt::format("worker-{:03}", i);
        worker.threads = 2;
        view.farm.workers.push_back(worker);
    }
    return view;
}

std::string text_of(const FarmView& view, Window window) {
    std::string text;
    for (const std::string& line : farm_screen(view, window))
        text += line + "\n";
    return text;
}

bool has(const std::string& text, std::string_view part) {
    return text.find(part) != std::string::npos;
}

} // namespace

TEST_CASE("the screen shows broker, jobs and workers") {
    const std::string text = text_of(farm(2, 3), {.columns = 120, .rows = 40});
    CHECK(has(text, "2 jobs, 0 not over; 3 workers, 6 threads"));
    CHECK(has(text, "tcp://127.0.0.1:50057  alone  0.1.0    1:30:00"));
    CHECK(has(text, "job-2"));
    CHECK(has(text, "worker-003"));
    CHECK_FALSE(has(text, "more"));
}

TEST_CASE("off a terminal the broker stands before all jobs and all workers") {
    FarmView view = farm(30, 100);
    std::string page = farm_page(view);
    CHECK(page.starts_with("BROKER "));
    const auto jobs = page.find("job-30"), workers = page.find("worker-001");
    CHECK(page.find("tcp://127.0.0.1:50057  alone  0.1.0    1:30:00") < jobs);
    CHECK(jobs < workers);
    CHECK(has(page, "job-1 "));
    CHECK(has(page, "worker-100"));
    view.connected = false;
    CHECK(has(farm_page(view), "tcp://127.0.0.1:50057  looking for it"));
}

TEST_CASE("what has no room on the screen is counted, and jobs that are not over stay") {
    FarmView view = farm(30, 100);
    view.farm.jobs[3].phase = protocol::JobPhase::running;
    const std::string text = text_of(view, {.columns = 120, .rows = 25});
    CHECK(std::ranges::count(text, '\n') == 25);
    CHECK(has(text, "job-4 "));
    CHECK(has(text, "job-30 "));
    CHECK_FALSE(has(text, "job-5 "));
    CHECK(has(text, "and 22 more jobs"));
    CHECK(has(text, "worker-001"));
    CHECK(has(text, "and 92 more workers"));
}

TEST_CASE("few jobs leave their room to the workers, and few workers to the jobs") {
    const std::string text = text_of(farm(1, 100), {.columns = 120, .rows = 40});
    CHECK(has(text, "and 69 more workers"));
    CHECK(has(text_of(farm(100, 1), {.columns = 120, .rows = 40}), "and 69 more jobs"));
    CHECK(has(text_of(farm(1, 31), {.columns = 120, .rows = 40}), "worker-031"));
}

TEST_CASE("the screen never has more lines or columns than the window") {
    FarmView view = farm(9, 9);
    view.farm.jobs[2].job_name = "光線追跡光線追跡光線追跡光線追跡";
    view.farm.workers[2].worker_name = "bob\x1b[2J\n";
    for (std::uint32_t rows = 2; rows < 40; ++rows)
        for (std::uint32_t columns = 2; columns < 130; columns += 7) {
            const auto lines = farm_screen(view, {.columns = columns, .rows = rows});
            CHECK(lines.size() <= rows);
            for (const std::string& line : lines) {
                CHECK(columns_of(line) <= columns);
                CHECK(line.find('\x1b') == std::string::npos);
            }
        }
}

TEST_CASE("names of wide characters do not move the columns behind them") {
    FarmView view = farm(2, 0);
    view.farm.jobs[0].job_name = "光線";
    const auto lines = farm_screen(view, {.columns = 120, .rows = 40});
    const auto column_of = [&](std::string_view word, std::string_view name) {
        for (const std::string& line : lines)
            if (line.find(name) != std::string::npos && line.find(word) != std::string::npos)
                return columns_of(line.substr(0, line.find(word)));
        return std::size_t{0};
    };
    CHECK(column_of("done", "光線") > 0);
    CHECK(column_of("done", "光線") == column_of("done", "job-2"));
}

TEST_CASE("a broker that is looked for, and a farm that is not known, are said") {
    FarmView view{"tcp://here:1", false, false, {}};
    const std::string text = text_of(view, {.columns = 80, .rows = 24});
    CHECK(has(text, "looking for it"));
    CHECK_FALSE(has(text, "no workers"));
}
