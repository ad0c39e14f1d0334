// Dispatcher: who helps out when nothing is left to be given: what will be done last is given out
// once more, in parts if that is possible, and whoever is first is right.
#include "broker/dispatcher.hpp"

#include "common/base/text.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <queue>

namespace fraja::broker {

using namespace protocol;

namespace {

// It must be worth it: what is saved, of the time that the tile would take otherwise.
constexpr double gain_min = 0.25;
constexpr double round_trip_s = 0.001;

// A tile that has taken longer than was thought: so much longer again, of the time that it has had.
constexpr double overdue_share = 0.5;

} // namespace

bool Dispatcher::somebody_is_idle() const {
    if (free_workers_.empty())
        return false;
    const WorkerSession& least = workers_.at(free_workers_.begin()->second);
    return least.held() < least.hello.threads;
}

bool Dispatcher::somebody_has_tiles() const {
    return std::ranges::any_of(jobs_, [](const auto& entry) {
        return entry.second.phase == JobPhase::running && entry.second.in_flight_count() > 0;
    });
}

/// What the worker has, and when it will be done.
void Dispatcher::append_ends(const PeerId& peer, const WorkerSession& worker,
                             std::vector<Late>& late) const {
    std::vector<std::pair<const GrantKey*, const Grant*>> grants;
    for (const auto& [key, grant] : worker.grants)
        if (!grant.cancelled)
            grants.emplace_back(&key, &grant);
    std::ranges::sort(grants, {}, [](const auto& g) { return g.second->number; });
    const double speed = speed_of(worker);
    std::priority_queue<double, std::vector<double>, std::greater<>> thread_free;
    for (const auto& [key, grant] : grants) {
        const double work_s = grant->work / speed;
        double end_s = 0;
        if (grant->started_at) {
            const double had_s = seconds(now_ - *grant->started_at);
            end_s = std::max(work_s - had_s, overdue_share * had_s);
        } else {
            if (!thread_free.empty()) {
                end_s = thread_free.top();
                thread_free.pop();
            }
            end_s += work_s;
        }
        thread_free.push(end_s);
        const auto job = jobs_.find(key->job);
        if (grant->id != OpenTileId::none && job != jobs_.end() && !job->second.is_dealt_out() &&
            job->second.phase == JobPhase::running && job->second.can_overbook(grant->id) &&
            job->second.assigned_as(grant->id, key->attempt))
            late.push_back(
                {from_seconds(std::min(end_s, 1e6)), key->job, grant->id, grant->work, peer});
    }
}

/// The last one first.
std::vector<Dispatcher::Late> Dispatcher::tiles_by_end() const {
    std::vector<Late> late;
    for (const auto& [peer, worker] : workers_)
        append_ends(peer, worker, late);
    std::ranges::stable_sort(late, std::greater<>{}, &Late::remaining);
    return late;
}

/// Who has a thread that does nothing.
std::vector<Dispatcher::Idle> Dispatcher::idle_workers() const {
    std::vector<Idle> idle;
    for (const auto& [load, peer] : free_workers_) {
        const WorkerSession& worker = workers_.at(peer);
        if (worker.held() >= worker.hello.threads)
            break; // as all that follow
        idle.push_back({peer, &worker, speed_of(worker), worker.hello.threads - worker.held()});
    }
    return idle;
}

/// The threads among them that may draw the job's tile, and the fastest of them.
Dispatcher::Help Dispatcher::help_for(const Late& late, const Job& job,
                                      const std::vector<Idle>& idle, double bearable_s) const {
    const bool is_time_to_fetch = seconds(fetch_times_.of(job.submission().scene)) < bearable_s;
    const bool can_cut = job.can_cut(job.tile(late.id));
    Help help;
    for (const Idle& one : idle) {
        if (!suits(*one.worker, one.peer, job.party()) || (!can_cut && one.peer == late.peer) ||
            (!is_time_to_fetch && !has_scene(*one.worker, job.submission().scene)))
            continue;
        help.speed = std::max(help.speed, one.speed);
        help.threads += one.threads;
    }
    if (!can_cut)
        help.threads = std::min<std::size_t>(help.threads, 1);
    return help;
}

void Dispatcher::help_out() {
    // It looks at all tiles: so not more often than these should end, whatever happens meanwhile.
    const double pause_s = std::min(tile_time_min_s(), seconds(limits_.overbook_interval));
    const Instant soon = overbooked_at_ + from_seconds(pause_s);
    if (!changed_workers_.empty())
        next_overbook_ = std::min(next_overbook_, soon);
    if (now_ < next_overbook_ || !speed_.is_known() || !somebody_is_idle())
        return;
    overbooked_at_ = now_;
    next_overbook_ = now_ + limits_.overbook_interval;
    std::vector<Idle> idle = idle_workers();
    std::size_t threads = 0;
    for (const Idle& one : idle)
        threads += one.threads;
    for (const Late& late : tiles_by_end()) {
        const double bearable_s = (1 - gain_min) * seconds(late.remaining);
        if (threads == 0 || bearable_s <= round_trip_s) // nor are those that follow worth it
            break;
        Job& job = jobs_.at(late.job);
        const Help help = help_for(late, job, idle, bearable_s);
        if (help.threads == 0)
            continue;
        const double parts_max = std::clamp(late.work / (tile_time_min_s() * help.speed), 1.0,
                                            static_cast<double>(limits_.overbooked_parts_max));
        const auto parts = std::min(static_cast<std::uint32_t>(help.threads),
                                    static_cast<std::uint32_t>(parts_max));
        if (late.work / parts / help.speed + round_trip_s > bearable_s)
            continue;
        const PixelRect r = job.rect(job.tile(late.id));
        log({.level = LogLevel::debug,
             .kind = "tile_late",
             .subject = to_string(job.id()),
             .text = "job #" + std::to_string(job.number()) + ", " + std::to_string(r.width) + "x" +
                     std::to_string(r.height) + " pixels at " + std::to_string(r.x) + "," +
                     std::to_string(r.y) + ": late on " + workers_.at(late.peer).hello.worker_name +
                     ", given out once more in " + counted(parts, "part")});
        job.overbook(late.id, parts);
        ++counters_.tiles_overbooked;
        look_ready(job);
        give_out();
        idle = idle_workers();
        threads -= std::min<std::size_t>(threads, parts);
    }
}

} // namespace fraja::broker
