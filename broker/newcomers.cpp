// Dispatcher: where more workers would not help. Whoever is new to a scene must fetch and compile
// it first; if all that is left of the job is done sooner by those who have it, it is left to them.
#include "broker/dispatcher.hpp"

#include <algorithm>

namespace fraja::broker {

using namespace protocol;

namespace {

// What is left may be so much more than is thought: where only pixels have been counted, and after.
constexpr double doubt_blank = 8, doubt = 1.25;

// Workers whose speeds are added up; more of them are taken to be as all are on the average.
constexpr std::size_t added_up_max = 64;

} // namespace

/// Films are left out, as whoever draws a frame is new to it; pictures with a time limit, for which
/// there is always more to do; the schedules that deal out once for all; orders, whose number the
/// broker above has in its hand; and jobs of which something has failed or was late.
bool Dispatcher::newcomers_help(const Job& job) const {
    const SubmitJob& s = job.submission();
    if (job.party().is_film() || is_order(job) || s.settings.limited_in_time() ||
        s.wishes.schedule != Schedule::demand || !speed_.is_known() || job.has_failures() ||
        job.was_overbooked())
        return true;
    const Duration start = head_start(job);
    // Others want the farm, too.
    const double left = job.costs().left() * (job.costs().is_blank() ? doubt_blank : doubt) *
                        static_cast<double>(ready_.group_count());
    return left > seconds(start) * capacity_ || left > seconds(start) * capacity_at(job) ||
           (job.held_since && !is_held_back(job)); // it was thought to be over by now
}

/// Of those who are at it.
double Dispatcher::capacity_at(const Job& job) const {
    const auto& workers = job.party().workers();
    if (workers.size() > added_up_max)
        return capacity_ * static_cast<double>(workers.size()) /
               static_cast<double>(std::max<std::size_t>(workers_with_credit_, 1));
    double rays_per_s = 0;
    for (const auto& [peer, tiles] : workers)
        rays_per_s += workers_.at(peer).capacity;
    const auto prober = workers_.find(job.prober);
    if (job.probe == Job::Probe::in_flight && prober != workers_.end() &&
        !workers.contains(job.prober))
        rays_per_s += prober->second.capacity;
    return rays_per_s;
}

/// What somebody new needs for the smallest tile.
Duration Dispatcher::head_start(const Job& job) const {
    return std::min(fetch_times_.of(job.submission().scene) + from_seconds(tile_time_min_s()),
                    limits_.held_back_max);
}

/// To be called where nobody who may have a tile of it has room.
void Dispatcher::hold_back(Job& job) {
    if (!job.held_since)
        job.held_since = now_;
    held_back_until_ = std::min(held_back_until_, *job.held_since + head_start(job));
}

bool Dispatcher::is_held_back(const Job& job) const {
    return job.held_since && now_ - *job.held_since < head_start(job);
}

void Dispatcher::release_held_back() {
    if (now_ < held_back_until_)
        return;
    held_back_until_ = Instant::never();
    ready_.unblock_if([](const ReadyJobs::Group&) { return true; });
}

bool Dispatcher::has_scene(const WorkerSession& worker, const ContentHash& scene) {
    return std::ranges::find(worker.scenes, scene) != worker.scenes.end();
}

/// Whether it is new to the worker.
bool Dispatcher::note_scene(WorkerSession& worker, const ContentHash& scene) const {
    const bool is_new = !forget_scene(worker, scene);
    if (worker.scenes.size() >= limits_.remembered_scenes_max)
        worker.scenes.erase(worker.scenes.begin());
    worker.scenes.push_back(scene);
    return is_new;
}

bool Dispatcher::forget_scene(WorkerSession& worker, const ContentHash& scene) {
    return std::erase(worker.scenes, scene) > 0;
}

/// Of a tile that its worker could begin with at once: what it took beside drawing.
void Dispatcher::learn_fetch_time(const ContentHash& scene, const Grant& grant, Duration elapsed) {
    if (!grant.fetches_scene || grant.started_at != grant.granted_at)
        return;
    const Duration had = now_ - grant.granted_at;
    fetch_times_.add(scene, had - std::clamp(elapsed, Duration::zero(), had));
}

} // namespace fraja::broker
