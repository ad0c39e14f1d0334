#include "client/page/page_json.hpp"

#include <doctest/doctest.h>
#include <nlohmann/json.hpp>

using namespace fraja;
using namespace fraja::client;
using namespace std::chrono_literals;
using Json = nlohmann::json;

namespace {

protocol::JobState job(std::uint32_t number, protocol::JobPhase phase) {
    protocol::JobState state;
    state.job = JobId{{static_cast<std::uint8_t>(number), static_cast<std::uint8_t>(number >> 8)}};
    state.number = number;
    state.job_name = "cone";
    state.phase = phase;
    return state;
}

} // namespace

TEST_CASE("a line about the farm is one line, whatever its names are") {
    FarmPage page;
    page.broker = "tcp://127.0.0.1:50057";
    page.farm.jobs = {job(1, protocol::JobPhase::failed)};
    page.farm.jobs[0].job_name = "</script>\n\xff";
    page.farm.jobs[0].reason = "no\nreason";
    const std::string line = farm_line(page);
    CHECK(line.find('\n') == std::string::npos);
    const Json farm = Json::parse(line).at("farm");
    CHECK(farm.at("jobs")[0].at("name") == "</script>\n\xef\xbf\xbd");
    CHECK(farm.at("jobs")[0].at("reason") == "no\nreason");
    CHECK(farm.at("connected") == false);
    CHECK(farm.at("allow_control") == false);
}

TEST_CASE("jobs that go on are listed before the newest of the others, and so many alone") {
    FarmPage page;
    for (std::uint32_t i = 1; i <= page_jobs_max + 50; ++i)
        page.farm.jobs.push_back(
            job(i, i <= 2 ? protocol::JobPhase::running : protocol::JobPhase::done));
    for (std::size_t i = 0; i < page_workers_max + 50; ++i) {
        protocol::WorkerState worker;
        worker.worker_name = std::to_string(1000 + i);
        worker.in_flight_count = i == 77 ? 1 : 0;
        page.farm.workers.push_back(worker);
    }
    const Json farm = Json::parse(farm_line(page)).at("farm");
    CHECK(farm.at("job_count") == page_jobs_max + 50);
    REQUIRE(farm.at("jobs").size() == page_jobs_max);
    CHECK(farm.at("jobs")[0].at("number") == 2);
    CHECK(farm.at("jobs")[1].at("number") == 1);
    CHECK(farm.at("jobs")[2].at("number") == page_jobs_max + 50);
    CHECK(farm.at("worker_count") == page_workers_max + 50);
    REQUIRE(farm.at("workers").size() == page_workers_max);
    CHECK(farm.at("workers")[0].at("name") == "1077");
    CHECK(farm.at("workers")[0].at("state") == "busy");
    CHECK(farm.at("workers")[1].at("name") == "1000");
}

TEST_CASE("a line about a job tells of its pictures when there are any") {
    JobPage page{.job = JobId{{7}}, .trouble = {}, .state = {}, .progress = {}, .costs = {}};
    CHECK(Json::parse(job_line(page)).at("job") ==
          Json{{"job", to_string(page.job)}, {"connected", false}, {"complete", false}});
    page.trouble = "there is no such job";
    CHECK(Json::parse(job_line(page)).at("job").at("trouble") == page.trouble);

    page.state = job(7, protocol::JobPhase::running);
    page.state->settings.size = {640, 480};
    page.state->settings.crop = {1, 2, 3, 4};
    HeatMap map({0, 0, 100, 1}, 1);
    for (std::uint32_t i = 0; i < 100; ++i) {
        protocol::TileDone tile;
        tile.rect = {i, 0, 1, 1};
        tile.worker_name = i < 60 ? "much" : std::to_string(i);
        map.add(tile);
    }
    page.map = &map;
    CHECK_FALSE(Json::parse(job_line(page)).at("job").contains("map"));
    page.revision = 3;
    const Json told = Json::parse(job_line(page)).at("job");
    CHECK(told.at("revision") == 3);
    CHECK(told.at("size") == Json{640, 480});
    CHECK(told.at("crop") == Json{{"x", 1}, {"y", 2}, {"w", 3}, {"h", 4}});
    CHECK(told.at("map").at("workers").size() == legend_workers_max);
    CHECK(told.at("map").at("worker_count") == 41);
    CHECK(told.at("map").at("workers")[0].at("name") == "much");
    CHECK(told.at("map").at("workers")[0].at("tiles") == 60);
}
