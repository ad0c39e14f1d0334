// Dispatcher: the broker begins to lead, or leads no more. Workers go on with the tiles that they
// have, whoever gave them.
#include "broker/dispatcher.hpp"
#include "broker/id_hash.hpp"

#include "common/base/rng.hpp"
#include "common/base/text.hpp"
#include "common/protocol/pixels.hpp"

#include <algorithm>

namespace fraja::broker {

using namespace protocol;

namespace {

constexpr std::uint32_t attempts_per_term = 1u << 20; // as far back as workers remember

} // namespace

Duration Dispatcher::gathering_time() const {
    return from_seconds(limits_.gathering_beats * seconds(limits_.heartbeat));
}

void Dispatcher::look_who_leads() {
    switch (membership_.update(now_)) {
    case Membership::Change::begins_to_lead:
        begin_to_lead();
        break;
    case Membership::Change::leads_no_more:
        stop_leading();
        break;
    case Membership::Change::none:
        break;
    }
    if (!gathers_until_)
        return;
    const bool all_told = std::ranges::none_of(
        workers_, [](const auto& entry) { return entry.second.tells_by.has_value(); });
    if (all_told || now_ >= *gathers_until_)
        end_gathering();
}

/// From here on no worker takes what an earlier leader gives it. What it was given before it says.
void Dispatcher::begin_to_lead() {
    if (is_alone())
        return;
    gathers_until_ = now_ + gathering_time();
    // So far from what others have counted that no two tiles at a worker bear one name.
    attempts_ +=
        attempts_per_term *
        static_cast<std::uint32_t>(1 + Rng(term().counter ^ hash_of(identity_.broker)).below(2048));
    const Membership::Peer* before = membership_.passed_over(now_);
    log({.level = before ? LogLevel::warning : LogLevel::info,
         .kind = "leads",
         .subject = {},
         .text = "this broker leads: it hands out the tiles (term " +
                 std::to_string(term().counter) + ")" +
                 (before ? "; no worker reaches " + named(before->rank.broker) +
                               ", which would lead before it"
                         : "")});
    for (auto& [peer, worker] : workers_)
        await_telling(peer, worker);
    tell_of_brokers();
}

void Dispatcher::end_gathering() {
    gathers_until_.reset();
    look_what_is_drawn_elsewhere();
    std::vector<JobId> done;
    for (auto& [id, job] : jobs_) {
        // Whoever said so is gone, and its tiles with it. They can be drawn again with the scene.
        if (job.awaited && job.holds_scene && job.phase != JobPhase::waiting_for_scene) {
            job.revision = {job.awaited->revision.counter, {}}; // its teller's word stays newer
            job.awaited.reset();
        }
        if (!job.may_run() && job.phase != JobPhase::paused)
            continue;
        (void)job.drop_unfinished();
        job.revive();
        job.probe = Job::Probe::over;
        want_probe(job);
        if (job.holds_scene)
            set_deadline(job);
        if (job.all_done())
            done.push_back(id);
    }
    void_again();
    for (auto& [peer, worker] : workers_)
        if (!worker.tells_by)
            adopt_in_hand(peer, worker);
    for (const auto& [id, job] : jobs_)
        look_ready(job);
    for (const JobId& id : done)
        if (Job* job = job_of(id))
            end_if_done(*job);
    std::size_t in_hand = 0;
    for (const auto& [peer, worker] : workers_)
        in_hand += worker.grants.size();
    log({.level = LogLevel::info,
         .kind = "took_over",
         .subject = {},
         .text = "has taken over: " + counted(in_hand, "tile") + " at " +
                 counted(workers_.size(), "worker") + ", " + counted(ready_.size(), "job") +
                 " to go on with"});
}

void Dispatcher::stop_leading() {
    gathers_until_.reset();
    log({.level = LogLevel::info,
         .kind = "leads_no_more",
         .subject = {},
         .text = "this broker leads no more (term " + std::to_string(term().counter) + ")"});
    for (auto& [peer, worker] : workers_) {
        worker.grants.clear();
        update_load(peer, worker);
    }
    for (auto& [id, job] : jobs_)
        if (job.may_run() || job.phase == JobPhase::paused) {
            (void)job.drop_unfinished();
            job.revive();
            look_ready(job);
        }
}

/// Also in the session before: that it greets anew moves none of its tiles.
auto Dispatcher::last_of(const WorkerSession& worker, const GrantKey& key) -> const InHand* {
    for (const auto* held : {&worker.in_hand, &worker.had_in_hand})
        if (const auto found = held->find(key); found != held->end())
            return &found->second;
    return nullptr;
}

/// What it has in hand, by its own word.
void Dispatcher::note_in_hand(const PeerId& peer, WorkerSession& worker, const WorkerBeat& beat) {
    std::map<GrantKey, InHand> now;
    for (const TileInFlight& tile : beat.in_flight) {
        const GrantKey key{tile.job, tile.tile, tile.attempt};
        const InHand* before = last_of(worker, key);
        const bool moves = before && tile.rays > before->tile.rays;
        now.emplace(key, InHand{tile, before && !moves ? before->progress_at : now_,
                                before ? before->seen_at : now_});
        if (moves)
            worker.moved_at = now_;
    }
    worker.in_hand = std::move(now);
    worker.had_in_hand.clear();
    if (!worker.has_told && !(beat.term < term())) { // late, perhaps
        if (deals_out())
            adopt_in_hand(peer, worker);
        worker.has_told = true;
        set_tells_by(peer, worker, std::nullopt);
    }
    count_those_of_others(peer, worker);
}

void Dispatcher::await_telling(const PeerId& peer, WorkerSession& worker) {
    worker.has_told = false;
    set_tells_by(peer, worker, now_ + gathering_time());
}

/// It goes on with what it was given before it was greeted anew, or by a leader of before.
void Dispatcher::count_those_of_others(const PeerId& peer, WorkerSession& worker) {
    worker.of_others = static_cast<std::size_t>(std::ranges::count_if(
        worker.in_hand, [&](const auto& entry) { return !worker.grants.contains(entry.first); }));
    update_load(peer, worker);
}

void Dispatcher::adopt_in_hand(const PeerId& peer, WorkerSession& worker) {
    for (const auto& [key, held] : worker.in_hand) {
        const TileInFlight& in_hand = held.tile;
        if (worker.grants.contains(key))
            continue;
        // Its next beat after it was given it would have told.
        Grant grant{.granted_at = held.seen_at - limits_.heartbeat,
                    .progress_at = held.progress_at,
                    .started_at = now_,
                    .rays = in_hand.rays,
                    .adopted = true};
        Job* job = job_of(in_hand.job);
        const auto tile = job ? job->tile_at(in_hand.pass, in_hand.rect) : std::nullopt;
        if (tile && (job->may_run() || job->phase == JobPhase::paused)) {
            grant.id = job->adopt(*tile, {peer, in_hand.attempt});
            grant.tile = *tile;
            grant.work = job->costs().work(tile->cells);
            if (job->phase == JobPhase::queued && grant.id != OpenTileId::none)
                job->phase = JobPhase::running;
            look_ready(*job);
        }
        worker.grants.emplace(key, std::move(grant));
    }
    count_those_of_others(peer, worker);
}

/// One that was greeted, or told that this broker leads, and has not said what it has.
void Dispatcher::wait_no_longer_for_silent_workers() {
    for (auto& [peer, worker] : workers_)
        if (worker.tells_by && now_ > *worker.tells_by) {
            if (deals_out())
                adopt_in_hand(peer, worker);
            set_tells_by(peer, worker, std::nullopt);
        }
}

/// A tile that another broker has handed out: workers answer all.
void Dispatcher::take_witnessed(WorkerSession& worker, const TileRendered& answer,
                                Duration longest) {
    Job* job = job_of(answer.job);
    if (!job || answer.rect.empty() || is_over(job->phase) ||
        job->phase == JobPhase::waiting_for_scene)
        return;
    const Rendered rendered = count_rendered(*job, worker, longest, answer);
    if (job->is_checked() && !deals_out()) // it comes from the one that leads
        return;
    const auto tile = job->tile_of(answer);
    if (!tile)
        return;
    if (job->all_cells_done(*tile)) {
        ++counters_.answers_unneeded;
        return;
    }
    ++counters_.tiles_done;
    take_result(*job, OpenTileId::none, *tile, rendered.work,
                std::make_shared<TileDone>(TileDone{.job = job->id(),
                                                    .tile = answer.tile,
                                                    .frame = job->submission().wishes.frame,
                                                    .pass = answer.pass,
                                                    .rect = answer.rect,
                                                    .worker_name = worker.hello.worker_name,
                                                    .rays = answer.rays,
                                                    .elapsed = rendered.elapsed,
                                                    .worker = worker.drawer,
                                                    .blobs = answer.blobs}),
                Giver::unknown);
}

} // namespace fraja::broker
