// Dispatcher: who gets which tile, and what becomes of it.
#include "broker/dispatcher.hpp"

#include "common/protocol/topics.hpp"

#include "common/base/assert.hpp"

#include <algorithm>

namespace fraja::broker {

using namespace protocol;

namespace {

std::string described(const Job& job, TileIndex tile) {
    const PixelRect& r = job.rect(tile);
    return "job #" + std::to_string(job.number()) + ", tile " +
           std::to_string(static_cast<std::uint32_t>(tile)) + " (" + std::to_string(r.x) + "," +
           std::to_string(r.y) + " " + std::to_string(r.width) + "x" + std::to_string(r.height) +
           ")";
}

} // namespace

void Dispatcher::update_load(const PeerId& peer, WorkerSession& worker) {
    std::optional<std::uint64_t> load;
    if (worker.grants.size() < worker.credit)
        load = (std::uint64_t{worker.grants.size()} << 16) / worker.hello.threads;
    if (load == worker.load)
        return;
    if (worker.load)
        free_workers_.erase({*worker.load, peer});
    if (load)
        free_workers_.insert({*load, peer});
    worker.load = load;
}

/// Higher priority first; of equals whoever has the fewest tiles in flight, so that jobs share the
/// farm.
Job* Dispatcher::job_for_next_tile() {
    Job* best = nullptr;
    const auto before = [](const Job& a, const Job& b) {
        if (a.submission().priority != b.submission().priority)
            return a.submission().priority > b.submission().priority;
        if (a.assignments().size() != b.assignments().size())
            return a.assignments().size() < b.assignments().size();
        return a.number() < b.number();
    };
    for (const JobId& id : ready_) {
        Job& job = jobs_.at(id);
        if (!best || before(job, *best))
            best = &job;
    }
    return best;
}

void Dispatcher::dispatch() {
    // A job whose pending tiles all failed on the workers that are free waits for others: it is
    // left out until something else happens.
    std::vector<JobId> passed_over;
    while (!free_workers_.empty()) {
        Job* job = job_for_next_tile();
        if (!job)
            break;
        // any_of stops at the grant, which changes free_workers_.
        const bool granted = std::ranges::any_of(free_workers_, [&](const auto& free) {
            const PeerId peer = free.second;
            return grant_tile(peer, workers_.at(peer), *job);
        });
        if (!granted) {
            passed_over.push_back(job->id());
            ready_.erase(job->id());
        }
    }
    for (const JobId& id : passed_over)
        ready_.insert(id);
}

bool Dispatcher::grant_tile(const PeerId& peer, WorkerSession& worker, Job& job) {
    const auto tile = job.assign_next(worker.hello.worker, peer, workers_with_credit_);
    if (!tile)
        return false;
    const AttemptNumber attempt = job.attempt(*tile);
    FRAJA_ASSERT(worker.grants.size() < worker.credit);
    worker.grants.emplace(
        GrantKey{job.id(), *tile, attempt},
        Grant{.granted_at = now_, .progress_at = now_, .number = worker.tiles_sent++});
    update_load(peer, worker);
    if (!job.has_pending())
        ready_.erase(job.id());
    const SubmitJob& s = job.submission();
    send(peer, RenderTile{.job = job.id(),
                          .tile = *tile,
                          .attempt = attempt,
                          .frame = 0,
                          .pass = job.pass(*tile),
                          .rect = job.rect(*tile),
                          .scene = s.scene,
                          .scene_bytes = s.scene_bytes,
                          .settings = s.settings});
    if (job.phase == JobPhase::queued) {
        job.phase = JobPhase::running;
        publish_state(job);
    }
    return true;
}

/// An answer has come: its credit is free again. Nothing when nobody waits for it.
std::optional<Dispatcher::Grant> Dispatcher::end_grant(const PeerId& peer, WorkerSession& worker,
                                                       const GrantKey& key) {
    const auto found = worker.grants.find(key);
    if (found == worker.grants.end()) {
        ++counters_.stale_answers;
        return std::nullopt;
    }
    const Grant grant = found->second;
    worker.grants.erase(found);
    update_load(peer, worker);
    return grant;
}

void Dispatcher::tile_rendered(const PeerId& peer, WorkerSession& worker,
                               const TileRendered& answer) {
    const GrantKey key{answer.job, answer.tile, answer.attempt};
    const auto grant = end_grant(peer, worker, key);
    if (!grant)
        return;
    Job* job = job_of(answer.job);
    if (!job || is_over(job->phase) || job->done(answer.tile)) {
        ++counters_.stale_answers;
        return;
    }
    std::uint64_t bytes = 0;
    for (const Blob& blob : answer.blobs)
        bytes += blob->size();
    const std::uint64_t wanted =
        job->rect(answer.tile).pixel_count() * job->submission().settings.pixel_bytes();
    if (bytes != wanted)
        return take_back(peer, key, true, worker,
                         "it sent " + std::to_string(bytes) + " bytes of pixels instead of " +
                             std::to_string(wanted));
    accept(*job, peer, worker, answer, now_ - grant->granted_at);
}

/// `elapsed_max` is how long the worker has had the tile: it cannot have rendered for longer.
void Dispatcher::accept(Job& job, const PeerId& peer, WorkerSession& worker,
                        const TileRendered& answer, Duration elapsed_max) {
    const auto assigned = job.assignments().find(answer.tile);
    if (assigned != job.assignments().end() &&
        !job.assigned_as(answer.tile, peer,
                         answer.attempt)) // somebody else is at it: not needed any more
        cancel_grant(assigned->second.peer, {job.id(), answer.tile, assigned->second.attempt});
    auto result = std::make_shared<TileDone>(
        TileDone{.job = job.id(),
                 .tile = answer.tile,
                 .frame = 0,
                 .pass = job.pass(answer.tile),
                 .rect = job.rect(answer.tile),
                 .worker_name = worker.hello.worker_name,
                 .rays = answer.rays,
                 .elapsed = std::clamp(answer.elapsed, Duration::zero(), elapsed_max),
                 .blobs = answer.blobs});
    ++worker.tiles_done;
    worker.rays += answer.rays;
    job.finish(answer.tile, result);
    if (!job.has_pending())
        ready_.erase(job.id());
    if (subscribed_jobs_.contains(job.id()))
        actions_->push_back(Publish{job_topic(job.id()), *result});
    if (job.all_done())
        end_job(job, JobPhase::done, "");
}

void Dispatcher::tile_failed(const PeerId& peer, WorkerSession& worker, const TileFailed& answer) {
    const GrantKey key{answer.job, answer.tile, answer.attempt};
    const auto grant = end_grant(peer, worker, key);
    if (!grant)
        return;
    Job* job = job_of(answer.job);
    if (!job || is_over(job->phase) || job->done(answer.tile))
        return;
    if (answer.code == FailureCode::scene)
        return end_job(*job, JobPhase::failed, answer.reason);
    // Who leaves has said so, by a credit of 0, before it hands back. Anybody else who cancels what
    // nobody asked it to would be given the same tile again, for ever: that is a failure.
    const bool at_its_own_wish =
        answer.code == FailureCode::cancelled && !grant->cancelled && worker.credit > 0;
    take_back(peer, key, answer.code == FailureCode::machine || at_its_own_wish, worker,
              answer.reason);
}

/// A grant has ended without an answer that counts: its tile goes to somebody else, if it is still
/// wanted and was not given to somebody else already.
void Dispatcher::take_back(const PeerId& peer, const GrantKey& key, bool counts,
                           const WorkerSession& worker, const std::string& why) {
    Job* job = job_of(key.job);
    if (!job || is_over(job->phase) || !job->has(key.tile) ||
        !job->assigned_as(key.tile, peer, key.attempt))
        return;
    ++counters_.tiles_requeued;
    job->requeue(key.tile);
    if (job->has_pending())
        ready_.insert(job->id());
    if (counts)
        count_failure(*job, key.tile, worker, why);
}

void Dispatcher::count_failure(Job& job, TileIndex tile, const WorkerSession& worker,
                               const std::string& why) {
    const std::uint32_t failures = job.count_failure(tile, worker.hello.worker);
    log(LogLevel::warning, described(job, tile) + " failed on " + worker.hello.worker_name + ", " +
                               std::to_string(failures) + " of " +
                               std::to_string(limits_.attempts_max) + " times: " + why);
    if (failures >= limits_.attempts_max)
        end_job(job, JobPhase::failed,
                described(job, tile) + " failed " + std::to_string(failures) +
                    " times, the last time on " + worker.hello.worker_name + ": " + why);
}

void Dispatcher::cancel_grant(const PeerId& peer, const GrantKey& key) {
    const auto worker = workers_.find(peer);
    if (worker == workers_.end())
        return;
    const auto grant = worker->second.grants.find(key);
    if (grant == worker->second.grants.end() || grant->second.cancelled)
        return;
    grant->second.cancelled = true;
    send(peer, CancelTile{key.job, key.tile, key.attempt});
}

void Dispatcher::take_back_stuck_tiles() {
    std::vector<std::pair<PeerId, GrantKey>> stuck;
    for (const auto& [peer, worker] : workers_) {
        // A tile waits its turn behind others: the lease runs only while none of its worker's tiles
        // moves.
        Instant moved_at{};
        for (const auto& [key, grant] : worker.grants)
            moved_at = std::max(moved_at, grant.progress_at);
        for (const auto& [key, grant] : worker.grants)
            if (!grant.cancelled &&
                now_ - (grant.rays > 0 ? grant.progress_at : moved_at) > limits_.lease)
                stuck.emplace_back(peer, key);
    }
    for (const auto& [peer, key] : stuck) {
        const auto worker = workers_.find(peer);
        cancel_grant(peer, key);
        take_back(peer, key, true, worker->second, "it traced no ray within the lease");
    }
}

} // namespace fraja::broker
