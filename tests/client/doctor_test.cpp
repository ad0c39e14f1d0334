#include "client/doctor.hpp"

#include "common/base/version.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <string>

using namespace fraja;
using namespace fraja::client;
using namespace std::chrono_literals;

namespace {

constexpr Duration noon = 20'000 * 24h + 12h; // since 1970

protocol::FarmState healthy() {
    protocol::FarmState farm;
    farm.broker.program_version = std::string(version);
    farm.broker.unix_time = noon;
    farm.broker.keeps = true;
    farm.broker.workers = 2;
    farm.broker.threads = 8;
    return farm;
}

/// What is said of it; a default one where nothing is.
Finding about(const std::string& subject, const protocol::FarmState& farm) {
    const auto findings = examine_farm(farm, noon);
    const auto found = std::ranges::find(findings, subject, &Finding::subject);
    return found == findings.end() ? Finding{} : *found;
}

} // namespace

TEST_CASE("a doctor finds nothing wrong with a farm that is well") {
    for (const Finding& finding : examine_farm(healthy(), noon + 1s)) {
        CAPTURE(finding.text);
        CHECK(finding.grade == Finding::Grade::good);
        CHECK(finding.cure.empty());
    }
}

TEST_CASE("a doctor finds what is wrong with a farm, and knows a cure") {
    struct Row {
        const char* subject;
        Finding::Grade grade;
        const char* text; ///< a part of it
        void (*harm)(protocol::BrokerState&);
    };
    using B = protocol::BrokerState;
    using enum Finding::Grade;
    for (const Row& row : {
             Row{"version", doubtful, "the broker's is 0.0.9",
                 [](B& b) { b.program_version = "0.0.9"; }},
             Row{"clocks", doubtful, "1:00 behind the broker's", [](B& b) { b.unix_time += 1min; }},
             Row{"clocks", doubtful, "2:00:00 ahead of the broker's",
                 [](B& b) { b.unix_time -= 2h; }},
             Row{"store", bad, "disk full", [](B& b) { b.trouble = "disk full"; }},
             Row{"workers", doubtful, "there is none", [](B& b) { b.workers = b.threads = 0; }},
             Row{"workers", doubtful, "2, and none may", [](B& b) { b.threads = 0; }},
             Row{"jobs", doubtful, "3 jobs to be rendered", [](B& b) { b.jobs_ready = 3; }},
         }) {
        CAPTURE(row.text);
        auto farm = healthy();
        row.harm(farm.broker);
        const Finding finding = about(row.subject, farm);
        CHECK(finding.grade == row.grade);
        CHECK(finding.text.find(row.text) != std::string::npos);
        CHECK_FALSE(finding.cure.empty());
    }
}

TEST_CASE("a doctor names workers of another release") {
    auto farm = healthy();
    const auto add = [&](const std::string& name, std::string_view release) {
        farm.workers.emplace_back().worker_name = name;
        farm.workers.back().program_version = release;
    };
    add("ada", version);
    CHECK(about("versions", farm) == Finding{});
    add("bob", "0.0.8");
    CHECK(about("versions", farm).text ==
          "worker bob is not of the broker's " + std::string(version) + ": 0.0.8");
    add("cleo", "0.0.9");
    add("dan", "0.0.8");
    const Finding finding = about("versions", farm);
    CHECK(finding.grade == Finding::Grade::doubtful);
    CHECK(finding.text ==
          "worker bob and 2 others are not of the broker's " + std::string(version) + ": 0.0.8");
    CHECK(finding.cure == "bring all machines to the same release");
}

TEST_CASE("clocks that differ by no more than the limit agree") {
    auto farm = healthy();
    farm.broker.unix_time = noon + clock_skew_max;
    CHECK(about("clocks", farm).grade == Finding::Grade::good);
    farm.broker.unix_time = noon - clock_skew_max - 1ns;
    CHECK(about("clocks", farm).grade == Finding::Grade::doubtful);
}

TEST_CASE("of a job that nobody is at, the cure is a command that says why") {
    auto farm = healthy();
    farm.broker.jobs_ready = 3;
    CHECK(about("jobs", farm).cure == "fraja-ctl show JOB says why it waits");
}

TEST_CASE("jobs that wait while tiles are drawn are no finding") {
    auto farm = healthy();
    farm.broker.jobs_ready = 3;
    farm.broker.tiles_in_flight = 1;
    CHECK(about("jobs", farm) == Finding{});
}

TEST_CASE("a doctor tells who of several brokers is here, who leads, and how many keep the jobs") {
    CHECK(about("brokers", healthy()) == Finding{}); // it has no others
    enum State { leads, stands_by, fetches, gone, unheard };
    struct Row {
        std::vector<State> states;
        Finding::Grade grade;
        const char* text;
    };
    using enum Finding::Grade;
    for (const Row& row : {
             Row{{leads, stands_by, stands_by}, good, "all 3 are here; tcp://0 leads"},
             Row{{stands_by, leads}, good, "all 2 are here; tcp://1 leads"},
             Row{{leads, gone},
                 doubtful,
                 "1 of 2 are here: tcp://1 is gone; jobs are kept by 1 of 2; tcp://0 leads"},
             Row{{stands_by, gone, unheard, leads},
                 doubtful,
                 "2 of 4 are here: tcp://1 is gone, tcp://2 was not heard of yet; jobs are kept by "
                 "2 of 4; tcp://3 leads"},
             Row{{leads, fetches},
                 doubtful,
                 "all 2 are here; tcp://1 fetches what the others have; jobs are kept by 1 of 2; "
                 "tcp://0 leads"},
             Row{{stands_by, stands_by}, doubtful, "all 2 are here; none leads"},
         }) {
        CAPTURE(row.text);
        auto farm = healthy();
        for (const State state : row.states) {
            const auto number = static_cast<std::uint8_t>(farm.brokers.size());
            farm.brokers.push_back(
                {.broker = state == unheard ? BrokerId{}
                                            : BrokerId{{static_cast<std::uint8_t>(number + 1)}},
                 .endpoint = "tcp://" + std::to_string(number),
                 .program_version = "1",
                 .is_here = state != gone && state != unheard,
                 .is_synced = state != fetches && state != unheard,
                 .leads = state == leads});
        }
        const Finding finding = about("brokers", farm);
        CHECK(finding.grade == row.grade);
        CHECK(finding.text == row.text);
        CHECK(finding.cure.empty() == (row.grade == good));
    }
}

TEST_CASE("a doctor looks at every side of this machine") {
    const auto findings = examine_machine();
    for (const char* subject : {"settings", "processors", "limits", "pictures", "folder", "state"})
        CHECK(std::ranges::count(findings, subject, &Finding::subject) == 1);
}

TEST_CASE("findings are lines, with what to do below") {
    CHECK(findings_page({{Finding::Grade::good, "a", "is well", {}}},
                        {{Finding::Grade::bad, "longer", "is not", "do this"},
                         {Finding::Grade::doubtful, "b", "may be", {}}}) ==
          "ok  a       is well\n"
          "\n"
          "BAD longer  is not\n"
          "            -> do this\n"
          "hm  b       may be\n");
}
