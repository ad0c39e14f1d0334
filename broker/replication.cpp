// Dispatcher: what other brokers have that is not here, and the reverse. All that there is only
// grows, or is the newest word; so whatever comes twice, late, or in another order does no harm.
#include "broker/dispatcher.hpp"
#include "broker/id_hash.hpp"
#include "broker/submission.hpp"
#include "common/base/rng.hpp"
#include "common/base/text.hpp"
#include "common/protocol/limits.hpp"
#include "common/protocol/passes.hpp"

#include <algorithm>
#include <utility>

namespace fraja::broker {

using namespace protocol;

namespace {

/// Followed or not.
const Revision& newest_word(const Job& job) {
    return job.awaited ? job.awaited->revision : job.revision;
}

std::uint64_t digest_of(const JobDigest& job) {
    return Rng(hash_of(job.job) ^ Rng(job.revision.counter ^ hash_of(job.revision.broker)).next() ^
               job.cells)
        .next();
}

} // namespace

// ------------------------------------------------------------------------------- what is here

JobDigests Dispatcher::job_digests() const {
    JobDigests digests{.jobs = {}, .epoch = heeded_term_.counter};
    for (const auto& [id, job] : jobs_)
        if (job.phase != JobPhase::waiting_for_scene && !is_order(job) && !job.is_partial_copy())
            digests.jobs.push_back({id, job.revision, job.done_hash()});
    return digests;
}

std::uint64_t Dispatcher::digest() const {
    std::uint64_t all = 0;
    for (const JobDigest& job : job_digests().jobs)
        all ^= digest_of(job);
    return all;
}

/// A job that is not kept yet is told of as it will be then.
JobRecord Dispatcher::record_of(const Job& job) const {
    const JobState state = job.state(term().counter, now_);
    return {.submission = job.submission(),
            .revision = job.revision,
            .number = job.number_wanted > 0 ? job.number_wanted : job.number(),
            .passes = job.passes(),
            .phase = job.phase == JobPhase::waiting_for_scene ? JobPhase::queued : job.phase,
            .reason = job.reason,
            .priority = job.priority,
            .done_count = static_cast<std::uint32_t>(job.done_count()),
            .age = now_ - job.submitted_at,
            .elapsed = state.elapsed,
            .over_for = job.over_at ? now_ - *job.over_at : Duration{},
            .checks = job.checks().counts(),
            .distrusted = job.distrusted(),
            .epoch = heeded_term_.counter};
}

/// Of what is wanted of the job, or has become of it. Others hear of it once its scene is here.
void Dispatcher::note_change(Job& job) {
    const bool is_told = job.phase != JobPhase::waiting_for_scene || job.is_being_kept;
    if (follows_ || is_order(job) || !is_told)
        return;
    job.revision = {job.revision.counter + 1, identity_.broker};
    if (!is_alone())
        changed_jobs_.insert(job.id());
}

void Dispatcher::tell_changes() {
    for (const JobId& id : std::exchange(changed_jobs_, {}))
        if (const Job* job = job_of(id); job && !job->is_partial_copy())
            tell_all(record_of(*job));
}

// ----------------------------------------------------------------------------- what is not here

void Dispatcher::compare(const BrokerId& broker, const JobDigests& theirs) {
    Colleague& colleague = colleagues_[broker];
    const bool is_leaders_word = leads_in(theirs.epoch, broker);
    bool lacks = false;
    std::size_t asked = 0;
    for (const JobDigest& their : theirs.jobs) {
        if (forgotten_.contains(their.job)) {
            tell(broker, JobForgotten{their.job});
            continue;
        }
        Job* job = job_of(their.job);
        if (job && !job->is_being_kept)
            note_copy(broker, *job);
        if (job && broker == term().leader && job->phase == JobPhase::done &&
            their.revision == job->revision && their.cells == job->done_hash())
            note_done_at_leader(*job);
        if (job && job->awaited && is_leaders_word && their.revision == job->awaited->revision &&
            !job->leader_agrees) {
            job->leader_agrees = true;
            settle(*job);
        }
        if (!job || newest_word(*job) < their.revision) {
            lacks = true;
            if (asked++ < limits_.copies_asked_max)
                tell(broker, WantJob{their.job});
        } else if (job->phase == JobPhase::waiting_for_scene) {
            lacks = true;
        } else if (job->done_hash() != their.cells && may_take_tiles(*job, broker, theirs.epoch)) {
            lacks = lacks || !colleague.repaired.contains(their.job);
            if (asked++ < limits_.copies_asked_max)
                ask_for_cells(broker, *job);
        }
    }
    colleague.is_compared = colleague.is_compared || !lacks;
}

void Dispatcher::ask_for_cells(const BrokerId& broker, const Job& job) {
    if (colleagues_[broker]
            .repairs.try_emplace(job.id(), AskedRepair{now_, job.done_hash()})
            .second)
        tell(broker, Repair{job.id(), limits_.repair_tiles_max, job.done().bytes()});
}

void Dispatcher::repair_done(const BrokerId& broker, const RepairDone& done) {
    Colleague& colleague = colleagues_[broker];
    const auto asked = colleague.repairs.find(done.state.job);
    if (asked == colleague.repairs.end())
        return;
    const Job* job = job_of(done.state.job);
    const bool has_brought_any = job && job->done_hash() != asked->second.cells;
    colleague.repairs.erase(asked);
    if (has_brought_any && done.remaining_count > 0)
        return ask_for_cells(broker, *job);
    colleague.repaired.insert(done.state.job);
    if (has_brought_any)
        colleague.compare_at = std::min(colleague.compare_at, now_); // perhaps that was all
}

/// A finished tile, as another broker has it.
void Dispatcher::take_tile(const BrokerId& broker, const TileDone& done) {
    Job* job = job_of(done.job);
    if (!job || is_order(*job) || job->phase == JobPhase::waiting_for_scene ||
        !may_take_tiles(*job, broker, done.epoch))
        return;
    const auto tile = job->tile_of(done);
    if (!tile || job->distrusts(done.worker) || job->all_cells_done(*tile))
        return;
    job->scene_came_on_at = now_;
    TileDone own = done;
    own.elapsed = std::max(own.elapsed, Duration{});
    take_result(*job, OpenTileId::none, *tile, static_cast<double>(done.rays.total()),
                std::make_shared<TileDone>(std::move(own)), Giver::known);
}

// -------------------------------------------------------------------------------------- jobs

void Dispatcher::take_record(const BrokerId& broker, const JobRecord& record) {
    const JobId& id = record.submission.job;
    if (forgotten_.contains(id))
        return tell(broker, JobForgotten{id});
    Job* job = job_of(id);
    if (!job)
        return adopt_job(broker, record, {});
    if (is_order(*job) || job->submission().scene != record.submission.scene ||
        job->submission().settings != record.submission.settings)
        return;
    if (job->phase == JobPhase::waiting_for_scene && !job->is_adopted && !job->is_being_kept) {
        const PeerId client = job->client();
        discard(id);
        return adopt_job(broker, record, client);
    }
    if (job->is_being_kept || job->phase == JobPhase::waiting_for_scene)
        job->waiting_for_copy.insert(broker);
    else
        tell(broker, JobKept{id});
    if (newest_word(*job) < record.revision)
        job->awaited.reset();
    const bool is_news = take_distrusted(id, record.distrusted);
    job = job_of(id);
    if (!job)
        return;
    if (!(newest_word(*job) < record.revision)) {
        if (is_news) // others may have what was known here before
            note_change(*job);
        return;
    }
    job->awaited = record;
    job->leader_agrees = leads_in(record.epoch, broker);
    settle(*job);
}

/// One that is not here. What is over needs no scene.
void Dispatcher::adopt_job(const BrokerId& broker, const JobRecord& record, const PeerId& client) {
    const SubmitJob& s = record.submission;
    const auto over =
        std::ranges::count_if(jobs_, [](const auto& entry) { return is_over(entry.second.phase); });
    const bool is_full = is_over(record.phase)
                             ? static_cast<std::size_t>(over) >= limits_.finished_jobs_max
                             : objection_to_one_more().has_value();
    if (is_full || fault_of(s) || record.distrusted.size() > distrusted_max || record.passes == 0 ||
        record.passes > pass_count(s.settings))
        return;
    Job fresh(s, record.number, client);
    fresh.set_passes(record.passes);
    // One that is done is so when its tiles are here. Until then it counts as older than it is.
    fresh.phase = is_over(record.phase) && record.phase != JobPhase::done
                      ? record.phase
                      : JobPhase::waiting_for_scene;
    fresh.holds_scene = is_over(record.phase); // so that no room is sought for it
    const auto room = room_for(fresh);
    if (!room) {
        log({.level = LogLevel::warning,
             .kind = "copy_refused",
             .subject = to_string(s.job),
             .text = "no copy of job " + s.job_name + " is kept here: " + room.error().message});
        return;
    }
    if (const Following following(follows_); is_over(record.phase)) {
        for (const JobId& id : *room)
            forget(id);
    } else {
        make_room(*room, s);
    }
    fresh.holds_scene = !is_over(record.phase);
    Job& job = jobs_.emplace(s.job, std::move(fresh)).first->second;
    job.join(party_of(job));
    job.is_adopted = true;
    job.leader_agrees = leads_in(record.epoch, broker);
    for (const Distrusted& who : record.distrusted)
        if (!job.distrusts(who.worker))
            (void)job.distrust(who);
    if (is_over(record.phase))
        job.set_check_counts(record.checks);
    job.priority = record.priority;
    job.revision = record.phase == JobPhase::done ? Revision{} : record.revision;
    job.submitted_at = now_ - std::max(record.age, Duration{});
    job.scene_came_on_at = now_;
    job.waiting_for_copy.insert(broker);
    give_number(job, record.number);
    log({.level = LogLevel::debug,
         .kind = "job_copied",
         .subject = to_string(s.job),
         .text = described(job) + ": a copy, from broker " + named(broker)});
    job.awaited = record;
    if (is_over(record.phase) || blobs_.complete(s.scene))
        return keep_job(job);
    fetch_scene(s.scene, broker);
}

/// What another broker has said of it and what can be followed now is.
void Dispatcher::settle(Job& job) {
    if (!job.awaited || job.is_being_kept)
        return;
    const JobRecord& word = *job.awaited;
    if (word.revision < job.revision) // something newer has become of it here
        return job.awaited.reset();
    const bool is_tried_again = is_over(job.phase) && !is_over(word.phase);
    if (job.phase == JobPhase::waiting_for_scene)
        return;
    if (ends_as_told(job))
        trust_as_told(job);
    if (word.phase == JobPhase::done && job.phase != JobPhase::done &&
        (job.done_count() < word.done_count || !job.first_pass_done() ||
         !is_checked_as_told(job))) { // its last tiles are still to come
        const Following following(follows_);
        if (job.phase == JobPhase::paused && job.holds_scene)
            (void)resume(job); // as it was before it was done
        return;
    }
    if (is_tried_again && !job.holds_scene) {
        const SubmitJob& s = job.submission();
        if (!blobs_.acquire(s.scene, s.scene_bytes))
            return;
        job.holds_scene = true;
    }
    if (const ContentHash& scene = job.submission().scene;
        is_tried_again && !blobs_.complete(scene)) {
        if (!fetches_.contains(scene)) // or others are asked in turn
            fetch_scene(scene, word.revision.broker);
        return;
    }
    const JobRecord record = std::move(*job.awaited);
    job.awaited.reset();
    follow(job, record);
    end_if_done(job);
    if (job.distrusted().size() > record.distrusted.size()) // what its teller does not know
        note_change(job);
}

void Dispatcher::follow(Job& job, const JobRecord& record) {
    job.revision = record.revision;
    const std::uint32_t unchecked = job.checks().counts().unchecked;
    const bool tells_otherwise =
        record.phase != JobPhase::done ||
        (membership_.leads() && job.is_checked() && record.checks.unchecked != unchecked);
    if (job.phase == JobPhase::done && tells_otherwise)
        return note_change(job); // it has all that can be: the others are told
    const Following following(follows_);
    if (job.priority != record.priority)
        set_priority(job, record.priority);
    if (job.number() != record.number)
        give_number(job, record.number);
    if (is_over(record.phase)) {
        if (is_over(job.phase) && job.phase == record.phase) {
            // Each may have come to its end by itself. Who has tiles of both is told the worse.
            job.has_more_unchecked = unchecked > record.checks.unchecked;
            if (job.phase == JobPhase::done && unchecked < record.checks.unchecked) {
                job.set_check_counts(record.checks);
                keep_phase(job);
            }
            if (job.leader_agrees)
                note_done_at_leader(job);
            return;
        }
        job.over_at.reset();
        if (record.phase == JobPhase::done) // or what was not checked here stays so, tried again
            job.set_check_counts(record.checks);
        end_job(job, record.phase, record.reason);
        job.over_at = now_ - std::max(record.over_for, Duration{});
        job.acknowledged_at = *job.over_at - std::max(record.elapsed, Duration{});
        return;
    }
    if (is_over(job.phase)) {
        if (const auto refused = retry(job))
            return;
        clear_deadline(job);
        job.submitted_at = now_ - std::max(record.age, Duration{});
        set_deadline(job);
        if (const auto peer = std::exchange(job.retried_by, std::nullopt))
            send(*peer, state_of(job));
    }
    if (record.phase == JobPhase::paused)
        (void)pause(job);
    else if (job.phase == JobPhase::paused)
        (void)resume(job);
    publish_state(job);
}

void Dispatcher::note_done_at_leader(Job& job) {
    if (job.has_more_unchecked) // whoever has tiles of the leader is not told of that
        return;
    if (std::exchange(job.done_in, term().counter) != term().counter && job.is_checked())
        publish_state(job);
}

/// Or, where another job has it, one of its own until that is settled.
void Dispatcher::give_number(Job& job, std::uint32_t number) {
    const auto taken = job_by_number_.find(number);
    const bool is_free = taken == job_by_number_.end() || taken->second == job.id();
    if (const auto own = job_by_number_.find(job.number());
        own != job_by_number_.end() && own->second == job.id())
        job_by_number_.erase(own);
    job.number_wanted = is_free ? 0 : number;
    job.set_number(is_free ? number : last_number_ + 1);
    last_number_ = std::max(last_number_, job.number());
    job_by_number_[job.number()] = job.id();
    look_ready(job);
    if (job.is_kept && !job.is_being_kept)
        persist(PutNumber{job.id(), job.number(), job.revision}, {.job = job.id()});
}

/// Two jobs that have come at the same time to two brokers have the same one: whoever leads gives
/// one of them another.
void Dispatcher::settle_numbers() {
    for (auto& [id, job] : jobs_) {
        if (job.number_wanted == 0 || job.is_being_kept || job.awaited ||
            job.phase == JobPhase::waiting_for_scene)
            continue;
        const auto taken = job_by_number_.find(job.number_wanted);
        if (taken == job_by_number_.end()) {
            give_number(job, job.number_wanted);
        } else if (membership_.leads()) {
            Job& other = jobs_.at(taken->second);
            Job& later = other.id() < id ? job : other;
            const std::uint32_t wanted = job.number_wanted;
            if (&later == &job) {
                job.number_wanted = 0; // as it is
            } else {
                give_number(other, last_number_ + 1);
                give_number(job, wanted);
            }
            note_change(later);
        }
    }
}

// ------------------------------------------------------------------------------------ copies

bool Dispatcher::needs_copy(const Job& job) const {
    if (job.is_adopted || now_ >= job.copied_by)
        return false;
    const auto here = membership_.here(now_);
    return std::ranges::any_of(here, [&](const BrokerId& id) {
        return membership_.peers().at(id).is_synced && !job.copies.contains(id);
    });
}

void Dispatcher::note_copy(const BrokerId& broker, const JobId& id) {
    if (Job* job = job_of(id)) {
        note_copy(broker, *job);
        acknowledge_if_safe(*job);
    }
}

void Dispatcher::note_copy(const BrokerId& broker, Job& job) {
    if (job.copies.insert(broker).second && !job.is_being_kept && !is_over(job.phase))
        publish_state(job);
}

/// But of those that are being kept it says so itself.
void Dispatcher::note_copies_of_all(const BrokerId& broker) {
    for (auto& [id, job] : jobs_)
        if (job.phase != JobPhase::waiting_for_scene && !job.is_being_kept && !is_order(job) &&
            !job.is_partial_copy())
            note_copy(broker, job);
}

/// It is gone: should this one be lost, it does not help that there is a copy.
void Dispatcher::forget_copies(const BrokerId& broker) {
    for (auto& [id, job] : jobs_)
        if (job.copies.erase(broker) > 0 && !is_over(job.phase))
            publish_state(job);
}

std::uint32_t Dispatcher::copies_wanted() const {
    const auto never_heard = std::ranges::count_if(
        lines_, [&](const auto& entry) { return is_to_nobody_known(entry.second); });
    return static_cast<std::uint32_t>(membership_.peers().size() +
                                      static_cast<std::size_t>(never_heard));
}

/// It is kept here, and by all others that are here: then any of them may be the one that is left.
void Dispatcher::acknowledge_if_safe(Job& job) {
    if (!job.is_being_kept || !job.is_stored || needs_copy(job))
        return;
    job.is_being_kept = job.is_stored = false;
    if (job.is_adopted && job.awaited && job.awaited->phase == JobPhase::done && !job.holds_scene) {
        job.phase = JobPhase::paused;
        job.reason = "its tiles are still to come from another broker";
        job.acknowledged_at = now_;
        const Following following(follows_);
        keep_phase(job);
    } else if (!is_over(job.phase)) {
        acknowledge(job);
    } else if (!job.acknowledged_at) { // it was cancelled before that, and may be tried again
        job.acknowledged_at = job.over_at;
    }
    if (job.is_adopted) {
        const bool is_told = job.awaited && is_over(job.awaited->phase) == is_over(job.phase);
        const JobRecord record = is_told ? *job.awaited : record_of(job);
        const Following following(follows_);
        if (is_over(job.phase)) {
            job.over_at = now_ - std::max(record.over_for, Duration{});
            job.acknowledged_at = *job.over_at - std::max(record.elapsed, Duration{});
            job.reason = record.reason;
            (void)job.drop_unfinished();
            keep_phase(job);
        } else {
            job.acknowledged_at = now_ - std::max(record.elapsed, Duration{});
        }
    } else if (!is_over(job.phase) && job.copies.empty() && copies_wanted() > 0) {
        const bool is_left_alone = membership_.here(now_).empty();
        log({.level = LogLevel::warning,
             .kind = "kept_alone",
             .subject = to_string(job.id()),
             .text = described(job) + " is kept by this broker alone: no other one " +
                     (is_left_alone ? "is here" : "has said that it has it")});
    }
    if (!job.is_adopted || !job.client().empty())
        send(job.client(), state_of(job));
    for (const BrokerId& broker : std::exchange(job.waiting_for_copy, {}))
        tell(broker, JobKept{job.id()});
    settle(job);
}

/// Its client submits it again, when it hears that there is no such job. Should the broker that had
/// the tiles come back, so does the job.
void Dispatcher::give_up_tiles_that_do_not_come() {
    std::vector<JobId> lost;
    for (const auto& [id, job] : jobs_)
        if (job.is_partial_copy() && now_ - job.scene_came_on_at > limits_.partial_copy_patience)
            lost.push_back(id);
    for (const JobId& id : lost) {
        const Job& job = jobs_.at(id);
        log({.level = LogLevel::warning,
             .kind = "copy_given_up",
             .subject = to_string(id),
             .text = described(job) + " was done, but no broker has its tiles any more: " +
                     std::to_string(job.done_count()) + " of " +
                     counted(state_of(job).cell_count, "cell") + " are here"});
        if (job.is_kept)
            persist(ForgetJob{id, true}, {.job = id});
        discard(id);
    }
}

// ------------------------------------------------------------------------------------ scenes

void Dispatcher::fetch_scene(const ContentHash& scene, const BrokerId& from) {
    fetches_[scene] = {from, now_};
    tell(from, NeedChunk{scene, blobs_.wanted_offset(scene)});
}

/// Whoever does not answer may be gone, or not have it.
void Dispatcher::fetch_scenes_anew() {
    std::erase_if(fetches_, [&](const auto& entry) {
        return blobs_.users(entry.first) == 0 || blobs_.complete(entry.first);
    });
    const auto here = membership_.here(now_);
    for (auto& [scene, fetch] : fetches_) {
        if (here.empty() || now_ - fetch.asked_at < limits_.heartbeat)
            continue;
        const auto next = std::ranges::upper_bound(here, fetch.from);
        fetch_scene(scene, next == here.end() ? here.front() : *next);
    }
}

void Dispatcher::take_scene_chunk(const BrokerId& broker, const Chunk& chunk) {
    const auto fetch = fetches_.find(chunk.blob);
    if (fetch == fetches_.end() || blobs_.users(chunk.blob) == 0)
        return;
    switch (blobs_.add(chunk)) {
    case BlobStore::Arrival::more:
    case BlobStore::Arrival::wrong_hash:
        for (auto& [id, job] : jobs_)
            if (job.submission().scene == chunk.blob)
                job.scene_came_on_at = now_;
        return fetch_scene(ContentHash(chunk.blob), broker);
    case BlobStore::Arrival::complete:
        fetches_.erase(fetch);
        begin_jobs_of(chunk.blob);
        for (auto& [id, job] : jobs_)
            if (job.submission().scene == chunk.blob)
                settle(job);
        return;
    case BlobStore::Arrival::ignored:
        return;
    }
}

} // namespace fraja::broker
