// Dispatcher: where more workers would not help. Whoever is new to a scene must fetch and compile
// it first; if all that is left of the job is done sooner by those who have it, it is left to them.
#include "broker/dispatcher.hpp"

#include <algorithm>

namespace fraja::broker {

using namespace protocol;

namespace {

// What is left may be so much more than is thought: where only pixels have been counted, and after.
constexpr double doubt_blank = 8, doubt = 1.25;

} // namespace

/// Films are left out, as whoever draws a frame is new to it; so are the schedules that deal out
/// once for all, and orders, whose number the broker above has in its hand.
bool Dispatcher::newcomers_help(const Job& job) const {
    if (job.party().is_film() || is_order(job) || !speed_.is_known() || job.has_failures() ||
        job.was_overbooked() || job.submission().wishes.schedule != Schedule::demand)
        return true;
    const Duration start = head_start(job);
    if (now_ - job.given_at >= start)
        return true; // those who have it have no time
    // Others want the farm, too.
    const double left = job.costs().left() * (job.costs().is_blank() ? doubt_blank : doubt) *
                        static_cast<double>(ready_.group_count());
    if (left > seconds(start) * capacity_)
        return true; // even if all had it
    double rays_per_s = 0;
    for (const auto& [peer, tiles] : job.party().workers())
        rays_per_s += workers_.at(peer).capacity;
    return left > seconds(start) * rays_per_s;
}

/// What somebody new needs for the smallest tile.
Duration Dispatcher::head_start(const Job& job) const {
    const auto tile =
        std::chrono::duration_cast<Duration>(std::chrono::duration<double>(tile_time_min_s()));
    return std::min(fetch_time(job) + tile, limits_.held_back_max);
}

/// Until somebody has fetched it, as little as for any scene: so nobody is kept away from a small
/// one as it was long for a large one.
Duration Dispatcher::fetch_time(const Job& job) const {
    return job.fetch_time.value_or(fetch_time_min_.value_or(Duration::zero()));
}

bool Dispatcher::has_scene(const WorkerSession& worker, const ContentHash& scene) {
    return std::ranges::find(worker.scenes, scene) != worker.scenes.end();
}

/// Whether it is new to the worker.
bool Dispatcher::note_scene(WorkerSession& worker, const ContentHash& scene) const {
    const auto known = std::ranges::find(worker.scenes, scene);
    const bool is_new = known == worker.scenes.end();
    if (!is_new)
        worker.scenes.erase(known);
    else if (worker.scenes.size() >= limits_.remembered_scenes_max)
        worker.scenes.erase(worker.scenes.begin());
    worker.scenes.push_back(scene);
    return is_new;
}

void Dispatcher::learn_fetch_time(Job& job, const Grant& grant, Duration elapsed) {
    if (!grant.fetches_scene)
        return;
    const Duration had = now_ - grant.started_at.value_or(grant.granted_at);
    const Duration beside = had - std::clamp(elapsed, Duration::zero(), had);
    const auto take_less = [&](std::optional<Duration>& least) {
        least = std::min(least.value_or(beside), beside);
    };
    take_less(job.fetch_time);
    take_less(fetch_time_min_);
}

void Dispatcher::release_held_back() {
    if (now_ < held_back_until_)
        return;
    held_back_until_ = Instant::never();
    ready_.unblock_if([](const ReadyJobs::Group&) { return true; });
}

} // namespace fraja::broker
