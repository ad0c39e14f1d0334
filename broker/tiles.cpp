// Dispatcher: what becomes of the tiles that were given out.
#include "broker/dispatcher.hpp"

#include "common/base/text.hpp"
#include "common/protocol/pixels.hpp"
#include "common/protocol/topics.hpp"

#include <algorithm>
#include <cmath>

namespace fraja::broker {

using namespace protocol;

namespace {

// Of a tile that takes longer than was thought: so much longer again, of the time that it is late.
constexpr double late_share = 0.5;

// So much counts what was found in a spot itself; the rest what was found there and around it.
constexpr double own_share = 0.5;

constexpr double worth_max = 1e9; // workers may say anything of their rays

} // namespace

void Dispatcher::count_begun(TilesBegun& all, const Job& job, const Tile& tile, double work,
                             double speed) const {
    const double thought = job.costs().work(tile.cells); // by what is known now
    all.work += work;
    all.thought += thought;
    all.expected += std::max(thought, work + late_share * (work - thought));
    all.per_s += speed;
}

/// Whoever asks this broker is told what is done of its jobs, whichever broker leads.
void Dispatcher::look_what_is_drawn_elsewhere() {
    for (auto& [id, job] : jobs_)
        job.elsewhere = {};
    if (deals_out())
        return;
    for (const auto& [peer, worker] : workers_) {
        const double speed = speed_of(worker);
        const JobId* last = nullptr;
        for (const auto& [key, held] : worker.in_hand) { // by jobs
            Job* job = job_of(key.job);
            if (!job || is_over(job->phase))
                continue;
            ++job->elsewhere.tiles;
            job->elsewhere.workers += !last || *last != key.job;
            last = &key.job;
            if (const auto tile = job->tile_at(held.tile.pass, held.tile.rect);
                tile && held.tile.rays > 0)
                count_begun(job->elsewhere.begun, *job, *tile, static_cast<double>(held.tile.rays),
                            speed);
        }
    }
}

/// The job's tiles that are being drawn, going by their workers' speeds and by when they began; of
/// those whose scene has to come first, by what has been heard. None of a picture with a time
/// limit, which the clock tells all of.
TilesBegun Dispatcher::begun(const Job& job) const {
    if (job.submission().settings.limited_in_time())
        return {};
    TilesBegun all = job.elsewhere.begun;
    for (const auto& [peer, count] : job.workers()) {
        const auto worker = workers_.find(peer);
        if (worker == workers_.end())
            continue;
        const double speed = speed_of(worker->second);
        const auto& grants = worker->second.grants;
        for (auto at = grants.lower_bound({job.id(), {}, {}});
             at != grants.end() && at->first.job == job.id(); ++at) {
            const auto& [key, grant] = *at;
            const bool is_drawn =
                grant.fetches_scene ? grant.has_begun() : grant.started_at.has_value();
            if (!is_drawn || !job.assigned_alone_as(grant.id, key.attempt))
                continue;
            const double work = grant.fetches_scene ? static_cast<double>(grant.rays)
                                                    : seconds(now_ - *grant.started_at) * speed;
            count_begun(all, job, grant.tile, work, speed);
        }
    }
    return all;
}

/// An answer has come: its credit is free again. Nothing when nobody waits for it.
std::optional<Dispatcher::Grant> Dispatcher::end_grant(const PeerId& peer, WorkerSession& worker,
                                                       const GrantKey& key) {
    const auto found = worker.grants.find(key);
    if (found == worker.grants.end()) {
        if (worker.in_hand.erase(key) > 0)
            count_those_of_others(peer, worker);
        return std::nullopt;
    }
    Grant grant = found->second;
    worker.grants.erase(found);
    note_overtaken(worker, grant.number);
    count_grant_of_order(key.job, false);
    if (grant.started_at) { // its thread goes on with the next one
        const auto next = std::ranges::min_element(worker.grants, {}, [](const auto& other) {
            return std::pair(other.second.started_at.has_value(), other.second.number);
        });
        if (next != worker.grants.end() && !next->second.started_at)
            next->second.started_at = now_;
    }
    update_load(peer, worker);
    changed_workers_.push_back(peer);
    return grant;
}

void Dispatcher::tile_rendered(const PeerId& peer, WorkerSession& worker,
                               const TileRendered& answer) {
    const GrantKey key{answer.job, answer.tile, answer.attempt};
    worker.moved_at = now_;
    // Its next beat after it was given it would have told.
    const InHand* held = last_of(worker, key);
    const Duration longest = limits_.heartbeat + (held ? now_ - held->seen_at : Duration{});
    const auto grant = end_grant(peer, worker, key);
    Job* job = job_of(answer.job);
    if (!worker.distrusted.empty() || (job && job->distrusts(worker.drawer))) {
        ++counters_.answers_distrusted;
        if (grant)
            (void)take_back(key, *grant, false, worker, "its pixels are wrong");
        return;
    }
    if (!is_alone() && (!grant || (grant->adopted && grant->id == OpenTileId::none)))
        return take_witnessed(worker, answer, longest);
    if (!grant || !job || is_over(job->phase)) {
        ++counters_.stale_answers;
        return;
    }
    const bool is_check = grant->check != CheckId::none;
    const bool is_probe = grant->id == OpenTileId::none && !is_check;
    if (is_probe ? job->probe != Job::Probe::in_flight
                 : !is_check && job->all_cells_done(grant->tile)) {
        ++counters_.answers_unneeded;
        return;
    }
    const std::uint64_t bytes = byte_count(answer.blobs);
    const std::uint64_t wanted =
        is_probe ? sizeof(float) * static_cast<std::uint64_t>(grant->work)
                 : job->rect(grant->tile).pixel_count() * job->submission().settings.pixel_bytes();
    if (bytes != wanted) {
        count_machine_failure(peer, worker);
        (void)take_back(key, *grant, true, worker,
                        "it sent " + std::to_string(bytes) + " bytes of pixels instead of " +
                            std::to_string(wanted));
        return;
    }
    learn_fetch_time(job->submission().scene, *grant, answer.elapsed);
    if (is_probe && is_order(*job))
        return fill_probe(*job, answer);
    if (is_probe)
        return take_probe(*job, answer, grant->probe_side);
    if (is_check)
        return check_rendered(*job, worker, *grant, answer.attempt, answer);
    accept(*job, worker, *grant, answer);
}

/// Each spot of the picture has the mean of the squares that it lies in, and in part of those
/// around: one ray may have missed what is dear, or met all of it.
void Dispatcher::take_probe(Job& job, const TileRendered& answer, std::uint32_t side) {
    std::vector<float> rays = floats_of(answer.blobs);
    for (float& ray_count : rays)
        if (!std::isfinite(ray_count) || ray_count <= 0)
            ray_count = 1;
    const PixelRect& crop = job.submission().settings.crop;
    const std::uint32_t columns = (crop.width + side - 1) / side;
    const std::uint32_t rows = (crop.height + side - 1) / side;
    const auto mean = [&](std::uint32_t x0, std::uint32_t y0, std::uint32_t x1, std::uint32_t y1) {
        double sum = 0;
        for (std::uint32_t y = y0; y <= y1; ++y)
            for (std::uint32_t x = x0; x <= x1; ++x)
                sum += static_cast<double>(rays[std::size_t{y} * columns + x]);
        return sum / ((x1 - x0 + 1.0) * (y1 - y0 + 1.0));
    };
    std::vector<double> spots(job.costs().spot_count());
    for (std::size_t i = 0; i < spots.size(); ++i) {
        const PixelRect spot = job.grid().pixels(job.costs().spot(i));
        const std::uint32_t x0 = (spot.x - crop.x) / side, y0 = (spot.y - crop.y) / side;
        const std::uint32_t x1 = (spot.x - crop.x + spot.width - 1) / side;
        const std::uint32_t y1 = (spot.y - crop.y + spot.height - 1) / side;
        spots[i] =
            own_share * mean(x0, y0, x1, y1) +
            (1 - own_share) * mean(std::max(x0, 1u) - 1, std::max(y0, 1u) - 1,
                                   std::min(x1 + 1, columns - 1), std::min(y1 + 1, rows - 1));
    }
    job.probe = Job::Probe::over;
    job.take_probe(spots);
    look_ready(job);
}

/// Where all machines get faster, it is the rays that get cheaper.
void Dispatcher::learn_speed(WorkerSession& worker, double rays, Duration elapsed) {
    const double before = worker.speed.is_known() ? speed_of(worker) : 0;
    worker.speed.add(rays, elapsed);
    speed_.add(rays, elapsed);
    count_capacity(worker);
    if (before <= 0 || worker.capacity <= 0)
        return;
    const double change = worker.capacity / capacity_ * (speed_of(worker) / before - 1);
    worth_of_rays_ = std::clamp(worth_of_rays_ * (1 + change), 1 / worth_max, worth_max);
}

/// `longest`: that it can have rendered, as it has not had the tile for longer.
Dispatcher::Rendered Dispatcher::count_rendered(Job& job, WorkerSession& worker, Duration longest,
                                                const TileRendered& answer) {
    const Duration elapsed = std::clamp(answer.elapsed, Duration::zero(), longest);
    ++worker.tiles_done;
    worker.rays += answer.rays;
    counters_.rays += answer.rays;
    counters_.render_time += std::min(elapsed, Duration::max() - counters_.render_time);
    const auto rays = static_cast<double>(answer.rays.total());
    learn_speed(worker, rays, elapsed);
    job.set_worth_of_rays(worth_of_rays_);
    return {elapsed, seconds(elapsed) > 0 ? seconds(elapsed) * speed_of(worker) : rays};
}

void Dispatcher::accept(Job& job, WorkerSession& worker, const Grant& grant,
                        const TileRendered& answer) {
    const auto [elapsed, work] = count_rendered(job, worker, now_ - grant.granted_at, answer);
    ++counters_.tiles_done;
    auto result = std::make_shared<TileDone>(TileDone{.job = job.id(),
                                                      .tile = answer.tile,
                                                      .frame = job.submission().wishes.frame,
                                                      .pass = job.pass(grant.tile),
                                                      .rect = job.rect(grant.tile),
                                                      .worker_name = worker.hello.worker_name,
                                                      .rays = answer.rays,
                                                      .elapsed = elapsed,
                                                      .worker = worker.drawer,
                                                      .blobs = answer.blobs});
    take_result(job, grant.id, grant.tile, work, std::move(result),
                grant.adopted ? Giver::unknown : Giver::known);
}

/// Wherever it was handed out.
void Dispatcher::take_result(Job& job, OpenTileId id, const Tile& tile, double work,
                             std::shared_ptr<const TileDone> result, Giver giver) {
    cancel_unwanted(job, job.finish(id, tile, work, result, now_));
    keep_newest_result(job);
    want_check(job, tile, *result, giver);
    if (subscribed_jobs_.contains(job.id()))
        actions_->push_back(Publish{job_topic(job.id()), as_sent_now(job, *result)});
    look_ready(job);
    if (job.awaited)
        settle(job);
    else
        end_if_done(job);
}

void Dispatcher::cancel_unwanted(const Job& job, const std::vector<Job::Unwanted>& unwanted) {
    for (const Job::Unwanted& at : unwanted)
        cancel_grant(at.assignment.peer, {job.id(), job.index(at.tile), at.assignment.attempt});
}

void Dispatcher::tile_failed(const PeerId& peer, WorkerSession& worker, const TileFailed& answer) {
    const GrantKey key{answer.job, answer.tile, answer.attempt};
    const auto grant = end_grant(peer, worker, key);
    if (answer.code != FailureCode::cancelled)
        worker.moved_at = now_;
    if (!grant) {
        counters_.stale_answers += is_alone();
        return;
    }
    Job* job = job_of(answer.job);
    if (job && grant->fetches_scene) // perhaps it has not come to that
        forget_scene(worker, job->submission().scene);
    if (!job || is_over(job->phase))
        return;
    if (answer.code == FailureCode::scene) {
        if ((grant->id == OpenTileId::none && is_order(*job)) || is_fault_of_scene(*job, worker))
            return end_job(*job, JobPhase::failed, answer.reason, FailureCode::scene);
        (void)take_back(key, *grant, true, worker, answer.reason);
        return;
    }
    // Who leaves has said so, by a credit of 0, before it hands back. Anybody else who cancels what
    // nobody asked it to would be given the same tile again, for ever: that is a failure.
    // Of several brokers another one may have asked it to.
    const bool at_its_own_wish = answer.code == FailureCode::cancelled && !grant->cancelled &&
                                 is_alone() && worker.credit > 0;
    const bool counts = answer.code == FailureCode::machine || at_its_own_wish;
    if (counts)
        count_machine_failure(peer, worker);
    (void)take_back(key, *grant, counts, worker, answer.reason);
}

/// When two workers find it, or the only one that may draw it: one alone may be broken, or of
/// another version. Until then nobody is to blame but the tile.
bool Dispatcher::is_fault_of_scene(Job& job, const WorkerSession& worker) const {
    const WorkerId& finder = worker.hello.worker;
    if (!job.scene_fault_found_by)
        job.scene_fault_found_by = finder;
    return job.scene_fault_found_by != finder || !has_others(job, std::span(&finder, 1));
}

/// A grant has ended without an answer that counts: its tile goes to somebody else, if it is still
/// wanted and was not given to somebody else already. Whether a failure of the tile was counted.
bool Dispatcher::take_back(const GrantKey& key, const Grant& grant, bool counts,
                           const WorkerSession& worker, const std::string& why) {
    Job* job = job_of(key.job);
    if (!job || is_over(job->phase))
        return false;
    if (grant.check != CheckId::none) {
        if (!job->check_assigned_as(grant.check, key.attempt))
            return false;
        job->take_back_check(grant.check,
                             counts ? std::optional(worker.hello.worker) : std::nullopt);
        look_ready(*job);
        end_if_done(*job);
        return false;
    }
    if (grant.id == OpenTileId::none) {
        take_back_probe(*job, counts, why);
        return false;
    }
    if (!job->assigned_as(grant.id, key.attempt))
        return false;
    ++counters_.tiles_requeued;
    job->requeue(grant.id);
    look_ready(*job);
    return counts && count_failure(*job, grant, worker, why);
}

/// The picture goes without; but it is all that is wanted of an order.
void Dispatcher::take_back_probe(Job& job, bool counts, const std::string& why) {
    if (job.probe != Job::Probe::in_flight)
        return;
    const auto order = orders_.find(job.id());
    if (order != orders_.end()) {
        order->second.failures += counts;
        if (order->second.failures >= limits_.attempts_max)
            return end_job(job, JobPhase::failed, why);
    }
    job.probe = order != orders_.end() ? Job::Probe::wanted : Job::Probe::over;
    look_ready(job);
}

bool Dispatcher::count_failure(Job& job, const Grant& grant, const WorkerSession& worker,
                               const std::string& why) {
    const std::uint32_t failures = job.count_failure(grant.id, worker.hello.worker);
    if (failures == 0)
        return false; // somebody else is at it
    ++counters_.tiles_failed;
    const std::string tile = described(job, grant.tile);
    log({.level = LogLevel::warning,
         .kind = "tile_failed",
         .subject = to_string(job.id()),
         .text = tile + " failed on " + worker.hello.worker_name + ", " + std::to_string(failures) +
                 " of " + std::to_string(limits_.attempts_max) + " times: " + why});
    if (failures >= limits_.attempts_max)
        end_job(job, JobPhase::failed,
                tile + " failed " + counted(failures, "time") + ", the last time on " +
                    worker.hello.worker_name + ": " + why);
    return true;
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

/// Workers begin their tiles in the order in which these come.
void Dispatcher::note_overtaken(WorkerSession& worker, std::uint64_t number) {
    for (auto& [key, grant] : worker.grants)
        if (grant.number < number && !grant.has_begun()) {
            grant.overtaken = true;
            grant.progress_at = now_;
        }
}

/// A tile waits its turn behind others of its worker: the lease of one that may not have begun runs
/// only while none of these moves. How many are drawn at once is not known of a branch.
bool Dispatcher::is_stuck(const WorkerSession& worker, bool has_begun, Instant progress_at) const {
    return now_ - (has_begun ? progress_at : std::max(progress_at, worker.moved_at)) >
           limits_.lease;
}

void Dispatcher::take_back_stuck_tiles() {
    std::vector<std::pair<PeerId, GrantKey>> stuck;
    for (const auto& [peer, worker] : workers_)
        for (const auto& [key, grant] : worker.grants)
            if (!grant.cancelled && is_stuck(worker, grant.has_begun(), grant.progress_at))
                stuck.emplace_back(peer, key);
    if (deals_out())
        for (const auto& [peer, worker] : workers_)
            stop_stuck_tiles_of_others(peer, worker);
    for (const auto& [peer, key] : stuck) {
        WorkerSession& worker = workers_.at(peer);
        const Grant grant = worker.grants.at(key);
        const bool at_work = grant.has_begun() || grant.started_at;
        cancel_grant(peer, key);
        if (at_work)
            count_machine_failure(peer, worker);
        (void)take_back(key, grant, at_work, worker, "it traced no ray within the lease");
    }
}

/// What another broker has given it, which is gone or has given it up: nobody else has it stopped.
void Dispatcher::stop_stuck_tiles_of_others(const PeerId& peer, const WorkerSession& worker) {
    if (worker.of_others == 0)
        return;
    for (const auto& [key, held] : worker.in_hand)
        if (!worker.grants.contains(key) && is_stuck(worker, held.tile.rays > 0, held.progress_at))
            send(peer, CancelTile{key.job, key.tile, key.attempt});
}

} // namespace fraja::broker
