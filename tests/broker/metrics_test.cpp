#include "broker/metrics.hpp"

#include "common/base/version.hpp"
#include "tests/support/file_bytes.hpp"

#include <cstdlib>
#include <doctest/doctest.h>
#include <fstream>
#include <string>
#include <utility>

using namespace fraja;
using namespace fraja::broker;
using namespace std::chrono_literals;

namespace {

/// No two numbers of it are the same.
Report some_report() {
    Report report;
    Figures& f = report.figures;
    f.term = 1;
    f.leads = true;
    f.brokers_here = 63;
    f.brokers_gone = 64;
    f.jobs_lacking_copies = 65;
    f.jobs = {2, 3, 4, 5, 6, 7, 8};
    f.jobs_ready = 9;
    f.cells_left = 10;
    f.work_left_s = 11.5;
    f.workers_idle = 12;
    f.workers_busy = 13;
    f.workers_draining = 14;
    f.workers_quarantined = 15;
    f.workers_distrusted = 62;
    f.threads = 16;
    f.credit = 17;
    f.tiles_in_flight = 18;
    f.clients = 19;
    f.jobs_watched = 20;
    f.scene_bytes = 21;
    f.unstored_bytes = 22;
    f.store_is_behind = true;
    f.store_trouble = "disk \"full\"";
    f.counters = {.rubbish = 23,
                  .wrong_version = 24,
                  .unexpected = 25,
                  .stale_answers = 26,
                  .peers_refused = 27,
                  .not_allowed = 56,
                  .workers_lost = 28,
                  .workers_quarantined = 29,
                  .tiles_failed = 30,
                  .tiles_requeued = 31,
                  .tiles_overbooked = 32,
                  .answers_unneeded = 33,
                  .answers_distrusted = 58,
                  .workers_distrusted = 59,
                  .tiles_unchecked = 60,
                  .tiles_checked = 61,
                  .tiles_sent = 34,
                  .tiles_done = 35,
                  .workers_welcomed = 36,
                  .jobs_acknowledged = 37,
                  .jobs_done = 38,
                  .jobs_failed = 39,
                  .jobs_cancelled = 40,
                  .rays = {.camera = 41, .reflected = 42, .refracted = 43, .shadow = 44},
                  .render_time = 45s};
    report.received_bytes = 46;
    report.sent_bytes = 47;
    report.published_bytes = 48;
    report.keys_refused = 57;
    report.keys_missing = 58;
    report.written = WriterTotals{.commits = 49, .failed_commits = 50, .bytes = 51};
    return report;
}

const ProcessUsage some_process{.cpu_s = 52.25,
                                .resident_bytes = 53,
                                .open_fds = 54,
                                .max_fds = 55,
                                .started_at_s = 1'700'000'000.5};

/// With the two words that every build has of its own replaced.
std::string neutral(std::string text) {
    for (const auto& [own, name] :
         {std::pair{std::string(version), "VERSION"}, {std::string(revision()), "REVISION"}})
        if (const auto at = text.find('"' + own + '"'); at != std::string::npos)
            text.replace(at + 1, own.size(), name);
    return text;
}

} // namespace

TEST_CASE("every number of a broker is a metric of its own") { // FRAJA_UPDATE=1 writes it anew
    const Report report = some_report();
    const std::string text = neutral(metrics_text({&report, some_process, StoreUsage{56, 57}}));
    const std::string path = std::string(FRAJA_SOURCE_DIR) + "/tests/broker/metrics.txt";
    if (std::getenv("FRAJA_UPDATE"))
        std::ofstream(path) << text;
    CHECK(text == bytes_of(path));
}

TEST_CASE("large numbers keep their digits") {
    Report report = some_report();
    report.figures.counters.rays.camera = 123'456'789'012'345;
    const std::string text = metrics_text({&report, some_process, std::nullopt});
    CHECK(text.find("rays_total{kind=\"camera\"} 123456789012345\n") != std::string::npos);
}

TEST_CASE("what there is not has no metric") {
    const auto has = [](const std::string& text, const char* words) {
        return text.find(words) != std::string::npos;
    };
    Report report = some_report();
    report.written.reset();
    const std::string kept_nowhere = metrics_text({&report, some_process, std::nullopt});
    CHECK_FALSE(has(kept_nowhere, "_store_"));
    CHECK(has(kept_nowhere, "fraja_broker_scene_bytes 21\n"));
    const std::string starting = metrics_text({nullptr, some_process, std::nullopt});
    CHECK(has(starting, "fraja_broker_info{"));
    CHECK(has(starting, "process_cpu_seconds_total 52.25\n"));
    CHECK_FALSE(has(starting, "fraja_broker_workers"));
}
