#include "client/json.hpp"

#include "client/settings_text.hpp"
#include "common/image/quantise.hpp"
#include "common/service/json_line.hpp"

#include <fmt/core.h>
#include <nlohmann/json.hpp>
#include <span>

namespace fraja::client {
namespace {

using Json = nlohmann::ordered_json; // in the order they are written here

/// One line. What is no UTF-8 (names come from others) is replaced, not refused.
std::string dumped(const Json& json) {
    return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

/// Adds what the rays were and what they cost.
void add_counts(Json& json, const protocol::Rays& rays) {
    json["rays"] = {{"primary", rays.camera},      {"camera", rays.camera}, // its earlier name
                    {"reflected", rays.reflected}, {"refracted", rays.refracted},
                    {"shadow", rays.shadow},       {"traced", rays.traced()},
                    {"total", rays.total()}};
    json["tests"] = {{"box", rays.box_tests}, {"form", rays.form_tests}};
    json["shaded"] = rays.shaded;
    json["pixels"] = {{"skipped", rays.skipped_pixels}, {"truncated", rays.truncated_pixels}};
}

Json settings_object(const protocol::PictureSettings& s) {
    return {{"width", s.size.width},
            {"height", s.size.height},
            {"crop", {s.crop.x, s.crop.y, s.crop.width, s.crop.height}},
            {"depth", s.depth},
            {"aa", s.aa},
            {"spp", s.spp},
            {"error", s.error},
            {"max_samples", s.max_samples},
            {"filter", to_string(s.filter)},
            {"time_limit_s", seconds(s.time_limit)},
            {"layers", s.layers},
            {"exact", s.exact},
            {"kernel", to_string(s.kernel)}};
}

void add_checks(Json& json, const protocol::JobState& s) {
    json["verify"] = s.verify;
    json["checks"] = {{"agreed", s.checks.agreed}, {"unchecked", s.checks.unchecked}};
    Json distrusted = Json::array();
    for (const protocol::Distrusted& who : s.distrusted)
        distrusted.push_back({{"worker", fraja::to_string(who.worker)},
                              {"name", who.worker_name},
                              {"reason", who.reason}});
    json["distrusted"] = std::move(distrusted);
}

void add_copies(Json& json, const protocol::JobState& s) {
    if (s.copies_wanted == 0) // the broker stands alone
        return;
    json["copies"] = s.copies;
    json["copies_wanted"] = s.copies_wanted;
}

Json job_object(const protocol::JobState& s) {
    Json json = {{"schema", "fraja.job/1"},
                 {"job", fraja::to_string(s.job)},
                 {"number", s.number},
                 {"name", s.job_name},
                 {"state", to_string(s.phase)}};
    if (!s.reason.empty())
        json["reason"] = s.reason;
    if (s.film != FilmId{}) {
        json["film"] = fraja::to_string(s.film);
        json["frame"] = s.frame;
    }
    json["scene"] = fraja::to_string(s.scene);
    json["settings"] = settings_object(s.settings);
    json["priority"] = s.priority;
    add_copies(json, s);
    json["cell_side"] = s.cell_side;
    json["cell_count"] = s.cell_count;
    json["done_count"] = s.done_count;
    json["share_done"] = s.share_done;
    json["share_per_s"] = s.share_per_s;
    json["in_flight_count"] = s.in_flight_count;
    json["worker_count"] = s.worker_count;
    add_checks(json, s);
    add_counts(json, s.rays);
    json["render_s"] = seconds(s.render_time);
    json["elapsed_s"] = seconds(s.elapsed);
    return json;
}

Json worker_object(const protocol::WorkerState& w) {
    Json json = {{"schema", "fraja.worker/1"},
                 {"worker", fraja::to_string(w.worker)},
                 {"name", w.worker_name},
                 {"version", w.program_version},
                 {"threads", w.threads},
                 {"credit", w.credit},
                 {"in_flight_count", w.in_flight_count},
                 {"tiles_done", w.tiles_done},
                 {"draining", w.draining},
                 {"quarantined_s", seconds(w.quarantined)},
                 {"tags", w.tags}};
    if (!w.distrusted.empty())
        json["distrusted"] = w.distrusted;
    add_counts(json, w.rays);
    return json;
}

} // namespace

std::string tile_json(const protocol::TileDone& tile) {
    return dumped({{"schema", "fraja.tile/1"},
                   {"job", fraja::to_string(tile.job)},
                   {"frame", tile.frame},
                   {"x", tile.rect.x},
                   {"y", tile.rect.y},
                   {"w", tile.rect.width},
                   {"h", tile.rect.height},
                   {"worker", tile.worker_name},
                   {"elapsed_s", seconds(tile.elapsed)},
                   {"rays", tile.rays.total()},
                   {"pass", tile.pass}});
}

std::string job_json(const protocol::JobState& state) {
    return dumped(job_object(state));
}

std::string worker_json(const protocol::WorkerState& state) {
    return dumped(worker_object(state));
}

namespace {

Json broker_object(const protocol::BrokerState& b) {
    const auto unix_time = std::chrono::system_clock::time_point(
        std::chrono::duration_cast<std::chrono::system_clock::duration>(b.unix_time));
    Json json = {{"schema", "fraja.broker/1"},          {"broker", fraja::to_string(b.broker)},
                 {"version", b.program_version},        {"uptime_s", seconds(b.uptime)},
                 {"time", service::rfc3339(unix_time)}, {"keeps", b.keeps}};
    if (!b.trouble.empty())
        json["trouble"] = b.trouble;
    json["jobs"] = {{"known", b.jobs},
                    {"ready", b.jobs_ready},
                    {"done", b.jobs_done},
                    {"failed", b.jobs_failed},
                    {"cancelled", b.jobs_cancelled}};
    json["workers"] = {{"count", b.workers},
                       {"threads", b.threads},
                       {"lost", b.workers_lost},
                       {"distrusted", b.workers_distrusted}};
    json["clients"] = b.clients;
    json["tiles"] = {{"in_flight", b.tiles_in_flight},   {"done", b.tiles_done},
                     {"failed", b.tiles_failed},         {"requeued", b.tiles_requeued},
                     {"overbooked", b.tiles_overbooked}, {"checked", b.tiles_checked}};
    json["rays"] = b.rays.total();
    json["render_s"] = seconds(b.render_time);
    return json;
}

} // namespace

std::string broker_json(const AskedBroker& asked) {
    if (!asked.farm)
        return dumped({{"schema", "fraja.broker/1"},
                       {"endpoint", asked.endpoint},
                       {"reason", asked.trouble}});
    Json json = broker_object(asked.farm->broker);
    json["endpoint"] = asked.endpoint;
    if (!asked.also_at.empty())
        json["also_at"] = asked.also_at;
    if (!asked.farm->brokers.empty()) {
        const protocol::PeerState& own = asked.farm->brokers.front();
        json["leads"] = own.leads;
        json["synced"] = own.is_synced;
        Json peers = Json::array();
        for (const protocol::PeerState& peer : std::span(asked.farm->brokers).subspan(1))
            peers.push_back({{"endpoint", peer.endpoint},
                             {"version", peer.program_version},
                             {"here", peer.is_here},
                             {"synced", peer.is_synced},
                             {"leads", peer.leads}});
        json["peers"] = std::move(peers);
    }
    return dumped(json);
}

std::string stats_json(const protocol::FarmState& farm) {
    return dumped(broker_object(farm.broker));
}

std::string key_json(const std::string& file, const std::string& public_key) {
    return dumped({{"schema", "fraja.key/1"}, {"file", file}, {"public", public_key}});
}

std::string finding_json(const Finding& f) {
    const char* const grade = f.grade == Finding::Grade::good  ? "good"
                              : f.grade == Finding::Grade::bad ? "bad"
                                                               : "doubtful";
    Json json = {
        {"schema", "fraja.finding/1"}, {"grade", grade}, {"subject", f.subject}, {"text", f.text}};
    if (!f.cure.empty())
        json["cure"] = f.cure;
    return dumped(json);
}

std::string farm_json(const protocol::FarmState& farm) {
    Json jobs = Json::array(), workers = Json::array();
    for (const auto& job : farm.jobs)
        jobs.push_back(job_object(job));
    for (const auto& worker : farm.workers)
        workers.push_back(worker_object(worker));
    return dumped({{"schema", "fraja.farm/1"},
                   {"broker", broker_object(farm.broker)},
                   {"jobs", jobs},
                   {"workers", workers}});
}

std::string progress_json(const ProgressView& v) {
    Json json = {{"schema", "fraja.progress/1"},
                 {"job", fraja::to_string(v.job)},
                 {"name", v.job_name},
                 {"number", v.number},
                 {"state", to_string(v.phase)},
                 {"done_count", v.done_count},
                 {"cell_count", v.cell_count},
                 {"share_done", v.share},
                 {"worker_count", v.worker_count},
                 {"rays_per_s", v.rays_per_s},
                 {"elapsed_s", seconds(v.elapsed)}};
    if (v.remaining)
        json["remaining_s"] = seconds(*v.remaining);
    json["connected"] = v.connected;
    return dumped(json);
}

std::string film_progress_json(const FilmView& v) {
    Json json = {{"schema", "fraja.film_progress/1"},     {"film", fraja::to_string(v.film)},
                 {"frames_done", v.moment.written},       {"frames", v.moment.frame_count},
                 {"frames_at_hand", v.moment.at_hand},    {"share_done", v.share},
                 {"worker_count", v.moment.worker_count}, {"rays_per_s", v.rays_per_s},
                 {"elapsed_s", seconds(v.elapsed)}};
    if (v.remaining)
        json["remaining_s"] = seconds(*v.remaining);
    return dumped(json);
}

std::string event_json(std::string_view event, std::string_view text) {
    return dumped({{"schema", "fraja.event/1"}, {"event", event}, {"text", text}});
}

std::string submit_json(const SubmissionReport& r) {
    Json json = {{"schema", "fraja.submit/1"}, {"state", r.state}};
    json["exit_code"] = static_cast<int>(r.outcome.code);
    if (!r.outcome.reason.empty())
        json["reason"] = r.outcome.reason;
    json["name"] = r.job_name;
    json["scene_file"] = r.scene_file;
    if (r.scene != ContentHash{}) // it was read
        json["scene"] = fraja::to_string(r.scene);
    json["settings"] = settings_object(r.settings);
    if (!r.output.empty())
        json["output"] = r.output;
    if (r.broker)
        json["broker"] = r.broker->empty() ? Json() : Json(*r.broker);
    if (r.job.number != 0 || r.job.job != JobId{}) {
        json["job"] = fraja::to_string(r.job.job);
        json["number"] = r.job.number;
        json["cell_count"] = r.job.cell_count;
        json["done_count"] = r.job.done_count;
        json["workers"] = r.workers;
        add_copies(json, r.job);
        add_checks(json, r.job);
        if (r.estimate)
            json["estimate"] = {{"samples_per_pixel", r.estimate->samples},
                                {"rms_error", r.estimate->rms_error},
                                {"rms_error_levels", levels_per_unit * r.estimate->rms_error},
                                {"pixels_at_ceiling", r.estimate->pixels_at_ceiling}};
        add_counts(json, r.job.rays);
        json["render_s"] = seconds(r.job.render_time);
        json["elapsed_s"] = seconds(r.job.elapsed);
        json["processor_s"] = seconds(r.processor_time);
    }
    json["wall_s"] = seconds(r.finished - r.started);
    json["started"] = service::rfc3339(r.started);
    json["finished"] = service::rfc3339(r.finished);
    return dumped(json);
}

std::string film_json(const FilmReport& r) {
    Json json = {{"schema", "fraja.film/1"}, {"exit_code", static_cast<int>(r.outcome.code)}};
    if (!r.outcome.reason.empty())
        json["reason"] = r.outcome.reason;
    json["film"] = fraja::to_string(r.film);
    json["name"] = r.job_name;
    json["scene_file"] = r.scene_file;
    json["travel_file"] = r.travel_file;
    json["settings"] = settings_object(r.settings);
    if (r.broker)
        json["broker"] = r.broker->empty() ? Json() : Json(*r.broker);
    Json frames = Json::array();
    for (const FilmReport::Frame& frame : r.frames) {
        Json one = {{"frame", frame.number}, {"state", frame.state}};
        if (!frame.reason.empty())
            one["reason"] = frame.reason;
        if (!frame.output.empty())
            one["output"] = frame.output;
        if (frame.job.job != JobId{}) {
            one["job"] = fraja::to_string(frame.job.job);
            one["number"] = frame.job.number;
            one["scene"] = fraja::to_string(frame.job.scene);
            one["elapsed_s"] = seconds(frame.job.elapsed);
            one["render_s"] = seconds(frame.job.render_time);
            add_copies(one, frame.job);
            add_checks(one, frame.job);
        }
        frames.push_back(std::move(one));
    }
    json["frames"] = std::move(frames);
    json["wall_s"] = seconds(r.finished - r.started);
    json["started"] = service::rfc3339(r.started);
    json["finished"] = service::rfc3339(r.finished);
    return dumped(json);
}

std::string_view to_string(protocol::JobPhase phase) {
    switch (phase) {
    case protocol::JobPhase::waiting_for_scene:
        return "waiting_for_scene";
    case protocol::JobPhase::queued:
        return "queued";
    case protocol::JobPhase::running:
        return "running";
    case protocol::JobPhase::paused:
        return "paused";
    case protocol::JobPhase::done:
        return "done";
    case protocol::JobPhase::failed:
        return "failed";
    case protocol::JobPhase::cancelled:
        return "cancelled";
    }
    return "unknown";
}

} // namespace fraja::client
