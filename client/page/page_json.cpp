#include "client/page/page_json.hpp"

#include "client/json.hpp"
#include "client/settings_text.hpp"

#include <algorithm>
#include <fmt/core.h>
#include <nlohmann/json.hpp>
#include <numeric>
#include <vector>

namespace fraja::client {
namespace {

using Json = nlohmann::ordered_json;

/// What is no UTF-8 (names come from others) is replaced, not refused.
std::string one_line(const Json& json) {
    return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

/// Pointers to the first `max` by that order.
template <class T, class Less>
std::vector<const T*> first_by(const std::vector<T>& all, std::size_t max, Less less) {
    std::vector<const T*> chosen;
    for (const T& one : all)
        chosen.push_back(&one);
    std::ranges::stable_sort(chosen, [&](const T* a, const T* b) { return less(*a, *b); });
    chosen.resize(std::min(chosen.size(), max));
    return chosen;
}

void add_progress(Json& json, const protocol::JobState& s, const ProgressView& view) {
    json["name"] = s.job_name;
    json["number"] = s.number;
    json["state"] = to_string(s.phase);
    if (!s.reason.empty())
        json["reason"] = s.reason;
    if (s.film != FilmId{})
        json["frame"] = s.frame;
    json["share_done"] = view.share;
    json["worker_count"] = s.worker_count;
    json["rays_per_s"] = view.rays_per_s;
    json["elapsed_s"] = seconds(s.elapsed);
    if (view.remaining)
        json["remaining_s"] = seconds(*view.remaining);
}

Json job_entry(const protocol::JobState& s, const std::map<JobId, ProgressMeter>& meters) {
    Json json = {{"job", fraja::to_string(s.job)}};
    const auto meter = meters.find(s.job);
    add_progress(json, s, meter == meters.end() ? ProgressView{} : meter->second.view());
    return json;
}

Json worker_entry(const protocol::WorkerState& w) {
    const char* state = !w.distrusted.empty()              ? "distrusted"
                        : w.quarantined > Duration::zero() ? "quarantined"
                        : w.draining                       ? "draining"
                        : w.in_flight_count > 0            ? "busy"
                                                           : "idle";
    return {{"name", w.worker_name},      {"state", state},
            {"threads", w.threads},       {"in_flight_count", w.in_flight_count},
            {"tiles_done", w.tiles_done}, {"rays", w.rays.total()}};
}

Json rect_object(const PixelRect& r) {
    return {{"x", r.x}, {"y", r.y}, {"w", r.width}, {"h", r.height}};
}

std::string css_colour(const Srgb8& c) {
    return fmt::format("#{:02x}{:02x}{:02x}", c[0], c[1], c[2]);
}

Json map_object(const HeatMap& map, const HeatMap::Costs& costs) {
    const auto& shares = map.shares();
    std::vector<std::size_t> numbers(shares.size());
    std::iota(numbers.begin(), numbers.end(), std::size_t{0});
    std::ranges::stable_sort(numbers, std::ranges::greater{},
                             [&](std::size_t i) { return shares[i].tiles; });
    Json workers = Json::array();
    for (std::size_t i = 0; i < std::min(numbers.size(), legend_workers_max); ++i)
        workers.push_back({{"name", shares[numbers[i]].name},
                           {"tiles", shares[numbers[i]].tiles},
                           {"colour", css_colour(worker_colour(numbers[i]))}});
    Json scale = Json::array();
    for (int i = 0; i <= 8; ++i)
        scale.push_back(css_colour(cost_colour(i / 8.0)));
    return {{"covered", rect_object(map.covered())},
            {"least_s", costs.least},
            {"most_s", costs.most},
            {"scale", scale},
            {"workers", workers},
            {"worker_count", shares.size()}};
}

} // namespace

std::string farm_line(const FarmPage& page) {
    Json jobs = Json::array(), workers = Json::array();
    const auto& farm = page.farm;
    for (const auto* job : first_by(farm.jobs, page_jobs_max, [](const auto&a, const auto&b) {
             return is_over(a.phase) != is_over(b.phase) ? !is_over(a.phase) : a.number > b.number;
         }))
        jobs.push_back(job_entry(*job, page.meters));
    for (const auto* worker :
         first_by(farm.workers, page_workers_max, [](const auto&a, const auto&b) {
             const bool a_works = a.in_flight_count > 0, b_works = b.in_flight_count > 0;
             return a_works != b_works ? a_works : a.worker_name < b.worker_name;
         }))
        workers.push_back(worker_entry(*worker));
    return one_line({{"farm",
                      {{"broker", page.broker},
                       {"connected", page.connected},
                       {"allow_control", page.allow_control},
                       {"first_job", page.first_job},
                       {"job_count", farm.jobs.size()},
                       {"worker_count", farm.workers.size()},
                       {"jobs", jobs},
                       {"workers", workers}}}});
}

std::string job_line(const JobPage& page) {
    Json json = {{"job", fraja::to_string(page.job)},
                 {"connected", page.connected},
                 {"complete", page.complete}};
    if (!page.trouble.empty())
        json["trouble"] = page.trouble;
    if (page.state) {
        const protocol::JobState& s = *page.state;
        add_progress(json, s, page.progress);
        json["settings"] = settings_text(s.settings);
        json["size"] = {s.settings.size.width, s.settings.size.height};
        json["crop"] = rect_object(s.settings.crop);
        json["scale"] = page.scale;
        json["revision"] = page.revision;
        if (page.map && page.revision > 0)
            json["map"] = map_object(*page.map, page.costs);
    }
    return one_line({{"job", json}});
}

} // namespace fraja::client
