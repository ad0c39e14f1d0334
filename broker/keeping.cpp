// Dispatcher: what is kept in the store, and what is found there.
#include "broker/dispatcher.hpp"

#include "common/base/assert.hpp"
#include "common/base/text.hpp"
#include "common/protocol/reasons.hpp"

#include <algorithm>

namespace fraja::broker {

using namespace protocol;

namespace {

std::string no_tagged_worker(const std::vector<std::string>& tags) {
    std::string options;
    for (const std::string& tag : tags)
        options += " --tag " + tag;
    return std::string("waiting: no worker that is connected has the ") +
           (tags.size() == 1 ? "tag " : "tags ") + comma_list(tags) + " (fraja-worker" + options +
           " starts one)";
}

constexpr const char* no_able_worker =
    "waiting: no worker that is connected may be given tiles: they drain or are in quarantine "
    "(fraja-ctl workers shows them, fraja-ctl undrain takes one back)";
constexpr const char* others_first =
    "waiting: jobs of a higher priority go first (fraja-ctl jobs shows them, fraja-ctl prio "
    "changes that)";
constexpr const char* late = "late: its time is up, and its first pass is not done yet";

} // namespace

void Dispatcher::persist(Write write, Unstored what) {
    what.sequence = ++persisted_;
    what.bytes = size_bytes(write);
    unstored_bytes_ += what.bytes;
    unstored_.push_back(what);
    actions_->push_back(Persist{what.sequence, std::move(write)});
}

/// Its scene is here. It is acknowledged when it is in the store, if there is one.
void Dispatcher::keep_job(Job& job) {
    const SubmitJob& s = job.submission();
    job.is_being_kept = true;
    job.copied_by = now_ + limits_.copy_patience;
    if (!job.is_adopted)
        note_change(job);
    if (!identity_.keeps) {
        job.is_stored = true;
        return acknowledge_if_safe(job);
    }
    job.is_kept = true;
    if (blobs_.complete(s.scene))
        persist(PutBlob{s.scene, blobs_.chunks(s.scene)}, {.job = job.id()});
    // A copy of what is over has no scene: it must not seem to go on, whenever this broker dies.
    const JobPhase phase = is_over(job.phase) ? job.phase
                           : job.holds_scene  ? JobPhase{}
                                              : JobPhase::paused;
    persist(PutJob{s, job.number(), job.passes(), job.revision, phase},
            {.job = job.id(), .acknowledges = true});
}

/// It has changed.
void Dispatcher::keep_phase(Job& job) {
    note_change(job);
    if (job.is_kept)
        persist(PutPhase{job.id(), job.phase, job.reason, state_of(job).elapsed, job.revision,
                         job.checks().counts()},
                {.job = job.id()});
}

void Dispatcher::keep_newest_result(const Job& job) {
    if (job.is_kept)
        persist(PutTile{job.results().back().pixels},
                {.job = job.id(), .result = job.results().size() - 1});
}

void Dispatcher::on(const Stored& event) {
    while (!unstored_.empty() && unstored_.front().sequence <= event.sequence) {
        const Unstored stored = unstored_.front();
        unstored_.pop_front();
        unstored_bytes_ -= stored.bytes;
        Job* job = job_of(stored.job);
        if (!job)
            continue;
        if (stored.result)
            job->release_pixels(*stored.result);
        if (stored.acknowledges) {
            job->is_stored = true;
            acknowledge_if_safe(*job);
        }
    }
}

void Dispatcher::on(const StoreFails& event) {
    store_trouble_ = event.reason;
    log({.level = LogLevel::error,
         .kind = "store_fails",
         .subject = {},
         .text = "nothing can be kept, so nothing is handed out: " + event.reason});
    for (const auto& [id, job] : jobs_)
        if (!is_over(job.phase))
            publish_state(job);
}

void Dispatcher::on(const StoreWorks&) {
    store_trouble_.clear();
    log({.level = LogLevel::info,
         .kind = "store_works",
         .subject = {},
         .text = "what is done is kept again: going on"});
    for (const auto& [id, job] : jobs_)
        if (!is_over(job.phase))
            publish_state(job);
}

JobState Dispatcher::state_of(const Job& job) const {
    JobState state = job.state(epoch_of(job), now_, begun(job));
    state.copies = static_cast<std::uint32_t>(job.copies.size());
    state.copies_wanted = copies_wanted();
    if (!store_trouble_.empty() && !is_over(job.phase))
        state.reason = std::string(
            clipped("waiting: the broker cannot keep what is done: " + store_trouble_, 500));
    else if (workers_.empty() && job.may_run())
        state.reason = protocol::no_worker_reason;
    else if (job.may_run() && lacks_tagged_worker(job))
        state.reason = std::string(clipped(no_tagged_worker(job.submission().wishes.tags), 500));
    else if (job.may_run() && workers_with_credit_ == 0)
        state.reason = no_able_worker;
    else if (const auto contested = job.may_run() ? contest(job) : std::nullopt)
        state.reason = std::string(clipped(*contested, 500));
    else if (job.may_run() && gives_way(job))
        state.reason = others_first;
    else if (job.may_run() && job.time_is_up())
        state.reason = late;
    return state;
}

bool Dispatcher::gives_way(const Job& job) const {
    const ReadyJobs::Group* const first = ready_.first();
    return first && first->priority > job.priority && job.in_flight_count() == 0;
}

bool Dispatcher::lacks_tagged_worker(const Job& job) const {
    const Wishes& wishes = job.submission().wishes;
    return !wishes.tags.empty() && job.workers().empty() &&
           std::ranges::none_of(workers_,
                                [&](const auto& entry) { return has_tags(entry.second, wishes); });
}

// ------------------------------------------------------------------------------ after a restart

void Dispatcher::on(const Restored& event) {
    FRAJA_ASSERT(identity_.keeps && jobs_.empty() && persisted_ == 0);
    for (const Tombstone& tombstone : event.contents.tombstones)
        bury(tombstone.job);
    for (const StoredJob& stored : event.contents.jobs)
        restore(stored, event);
    last_number_ = std::max(last_number_, event.contents.last_number);
    membership_.learn({event.contents.last_term, {}});
    if (!jobs_.empty())
        log({.level = LogLevel::info,
             .kind = "restored",
             .subject = {},
             .text = counted(jobs_.size(), "job") + " from before, " +
                     std::to_string(ready_.size()) + " to go on with"});
}

void Dispatcher::restore(const StoredJob& stored, const Restored& event) {
    const JobId id = stored.submission.job;
    Job& job = jobs_.emplace(id, Job(stored.submission, stored.number, {})).first->second;
    job.join(party_of(job));
    job.set_passes(stored.passes);
    job.revision = stored.revision;
    job_by_number_[stored.number] = id;
    last_number_ = std::max(last_number_, stored.number);
    job.is_kept = true;
    job.phase =
        stored.phase == JobPhase::paused || is_over(stored.phase) ? stored.phase : JobPhase::queued;
    job.reason = stored.reason;
    for (const Distrusted& who : stored.distrusted)
        (void)job.distrust(who);
    if (is_over(stored.phase))
        job.set_check_counts(stored.checks);
    for (const StoredTile& tile : stored.tiles)
        if (job.restore(tile) && stored.phase != JobPhase::done) {
            const Tile& restored = job.results().back().tile;
            if (is_to_be_checked(job, restored, Giver::known))
                job.want_check(restored, {tile.worker, tile.worker_name, tile.pixels});
        }
    const Duration over_for = stored.over_for.value_or(Duration::zero());
    // Of a job that was at it when its broker died nobody knows how long that took.
    const Duration elapsed = is_over(stored.phase) ? stored.elapsed : stored.age;
    job.submitted_at = now_ - stored.age;
    job.scene_came_on_at = now_; // other brokers have not been heard yet
    job.acknowledged_at = now_ - over_for - elapsed;
    if (is_over(job.phase))
        job.over_at = now_ - over_for;
    job.end_restoring();
    if (is_over(job.phase))
        return;
    const auto scene = event.scenes.find(job.submission().scene);
    if (scene == event.scenes.end() && job.is_partial_copy() && job.revision == Revision{})
        return;
    set_deadline(job);
    if (scene == event.scenes.end() || scene->second.size() != job.submission().scene_bytes ||
        !blobs_.acquire(scene->first, scene->second.size()))
        return end_job(job, JobPhase::failed, "its scene is not in the store any more");
    job.holds_scene = true;
    bring_scene(scene->first, Blob(scene->second));
    if (job.all_done() && job.checks().empty())
        return end_job(job, JobPhase::done, "");
    want_probe(job);
    look_ready(job);
}

void Dispatcher::on(const SceneLoaded& event) {
    Job* job = job_of(event.job);
    if (!job || job->holds_scene || !is_over(job->phase))
        return;
    const ContentHash& scene = job->submission().scene;
    if (event.scene && event.scene->size() == job->submission().scene_bytes &&
        blobs_.acquire(scene, event.scene->size())) {
        job->holds_scene = true;
        bring_scene(scene, Blob(*event.scene));
    }
    if (!job->holds_scene && ask_others_to_retry(*job, event.peer))
        return;
    if (const auto refused = retry(*job))
        return send(event.peer, *refused);
    end_if_done(*job);
    publish_state(*job);
    send(event.peer, state_of(*job));
}

// ----------------------------------------------------------------------------------- forgetting

void Dispatcher::forget_what_is_old() {
    std::vector<JobId> old;
    for (const auto& [id, job] : jobs_)
        if (job.over_at && now_ - *job.over_at > limits_.keep)
            old.push_back(id);
    for (const JobId& id : old)
        forget(id);
}

/// Its id is not used again, as long as that can be remembered: whoever submits it once more has
/// not heard that it is over.
void Dispatcher::bury(const JobId& job) {
    if (!forgotten_.insert(job).second)
        return;
    forgotten_in_order_.push_back(job);
    if (forgotten_in_order_.size() > limits_.tombstones_max) {
        forgotten_.erase(forgotten_in_order_.front());
        forgotten_in_order_.pop_front();
    }
}

} // namespace fraja::broker
