// Dispatcher: what is to be done.
#include "broker/dispatcher.hpp"
#include "broker/submission.hpp"
#include "common/base/assert.hpp"
#include "common/base/text.hpp"
#include "common/protocol/limits.hpp"
#include "common/protocol/passes.hpp"

#include <algorithm>

namespace fraja::broker {

using namespace protocol;

namespace {

/// And not for the store to have it.
bool is_waiting_for_scene(const Job& job) {
    return job.phase == JobPhase::waiting_for_scene && !job.is_being_kept;
}

RefusalCode refusal_of(ErrorCode code) {
    return code == ErrorCode::limit_exceeded ? RefusalCode::limit_exceeded : RefusalCode::invalid;
}

} // namespace

std::optional<Refused> Dispatcher::objection(const SubmitJob& s) const {
    const auto refused = [&](RefusalCode code, std::string reason) {
        return Refused{code, s.job, std::move(reason)};
    };
    if (const auto fault = fault_of(s))
        return refused(RefusalCode::invalid, *fault);
    if (const auto why = objection_to_film(s.wishes))
        return refused(RefusalCode::invalid, *why);
    if (s.wishes.schedule != Schedule::demand && s.tile_side > 0 &&
        cell_count(s) > limits_.dealt_cells_max)
        return refused(RefusalCode::invalid, "at most " + std::to_string(limits_.dealt_cells_max) +
                                                 " tiles are dealt out at once");
    if (const auto full = objection_to_one_more())
        return refused(RefusalCode::limit_exceeded, *full);
    return std::nullopt;
}

std::optional<std::string> Dispatcher::objection_to_one_more() const {
    const auto live = std::ranges::count_if(job_by_number_, [this](const auto& entry) {
        return !is_over(jobs_.at(entry.second).phase);
    });
    if (static_cast<std::size_t>(live) >= limits_.jobs_max)
        return "this broker takes " + counted(limits_.jobs_max, "job") + " at a time";
    return std::nullopt;
}

/// Of a client that is here. What is over takes up nothing of its share.
std::optional<std::string> Dispatcher::objection_to_share(const Job& wanted) const {
    if (!clients_.contains(wanted.client()))
        return std::nullopt;
    std::uint64_t promised = wanted.promised_bytes();
    for (const auto& [id, job] : jobs_)
        if (id != wanted.id() && job.client() == wanted.client() && !is_over(job.phase))
            promised += job.promised_bytes();
    if (promised > limits_.client_bytes_max)
        return "this broker stores pictures of at most " +
               std::to_string(limits_.client_bytes_max) + " bytes at a time for one client";
    return std::nullopt;
}

namespace {

/// Leaves the job as many passes as fit, at least one: then false where even that does not.
bool cut_to_fit(Job& job, const auto& fits) {
    std::uint32_t good = 0, bad = job.passes();
    if (fits())
        return true;
    while (bad - good > 1) {
        const std::uint32_t between = good + (bad - good) / 2;
        job.set_passes(between);
        (fits() ? good : bad) = between;
    }
    job.set_passes(std::max(good, 1u));
    return good > 0;
}

} // namespace

/// What of that which is over must go for `wanted` to have room, the oldest first; or why it has
/// none even so. Nothing is forgotten for what is refused then.
Result<std::vector<JobId>> Dispatcher::room_for(const Job& wanted) const {
    const auto full = [](const std::string& what, std::uint64_t bytes) {
        return Error{ErrorCode::limit_exceeded,
                     "this broker " + what + " of at most " + std::to_string(bytes) + " bytes"};
    };
    std::uint64_t stored = wanted.promised_bytes(), over = 0;
    for (const auto& [id, job] : jobs_)
        if (id != wanted.id())
            (is_over(job.phase) ? over : stored) += job.stored_bytes();
    if (stored > limits_.stored_bytes_max)
        return full("stores pictures", limits_.stored_bytes_max);
    const SubmitJob& s = wanted.submission();
    const auto more = wanted.holds_scene ? Result<std::uint64_t>(std::uint64_t{0})
                                         : blobs_.bytes_more(s.scene, s.scene_bytes);
    if (!more)
        return more.error();
    const auto excess = [](std::uint64_t bytes, std::uint64_t bytes_max) {
        return bytes > bytes_max ? bytes - bytes_max : 0;
    };
    auto going = oldest_to_free(wanted, excess(stored + over, limits_.stored_bytes_max),
                                excess(blobs_.bytes() + *more, limits_.blob_bytes_max));
    if (!going)
        return full("holds scenes", limits_.blob_bytes_max);
    return std::move(*going);
}

/// Nothing where all that is over does not free so much, beside the scene that is wanted.
std::optional<std::vector<JobId>> Dispatcher::oldest_to_free(const Job& wanted,
                                                             std::uint64_t picture_bytes,
                                                             std::uint64_t scene_bytes) const {
    std::vector<JobId> going;
    std::uint64_t pictures = 0, scenes = 0;
    std::map<ContentHash, std::uint32_t> users; // that go
    for (const auto& [number, id] : job_by_number_) {
        if (pictures >= picture_bytes && scenes >= scene_bytes)
            break;
        const Job& job = jobs_.at(id);
        if (id == wanted.id() || !is_over(job.phase))
            continue;
        going.push_back(id);
        pictures += job.stored_bytes();
        const ContentHash& scene = job.submission().scene;
        if (job.holds_scene && scene != wanted.submission().scene &&
            blobs_.users(scene) == ++users[scene])
            scenes += job.submission().scene_bytes;
    }
    return pictures >= picture_bytes && scenes >= scene_bytes ? std::optional(going) : std::nullopt;
}

/// The scene of what is to come is held from then on, also where it was held for what goes.
void Dispatcher::make_room(const std::vector<JobId>& going, const SubmitJob& coming) {
    const bool is_known = blobs_.users(coming.scene) > 0;
    const auto acquire = [&] {
        const auto acquired = blobs_.acquire(coming.scene, coming.scene_bytes);
        FRAJA_ASSERT(acquired.has_value());
    };
    if (is_known)
        acquire();
    for (const JobId& id : going)
        forget(id);
    if (!is_known)
        acquire();
}

std::optional<std::string> Dispatcher::objection_to_film(const Wishes& wishes) const {
    const auto found = films_.find(wishes.film);
    if (found == films_.end())
        return std::nullopt;
    Wishes others = found->second.lock()->wishes();
    others.frame = wishes.frame;
    return others == wishes ? std::nullopt
                            : std::optional("the film's other frames have other wishes");
}

/// Its film's, or its own.
std::shared_ptr<Party> Dispatcher::party_of(const Job& job) {
    const Wishes& wishes = job.submission().wishes;
    if (wishes.film == FilmId{})
        return std::make_shared<Party>(++parties_, wishes);
    std::weak_ptr<Party>& film = films_[wishes.film];
    std::shared_ptr<Party> party = film.lock();
    if (!party)
        film = party = std::make_shared<Party>(++parties_, wishes);
    return party;
}

void Dispatcher::submit(const PeerId& peer, const SubmitJob& submission) {
    if (forgotten_.contains(submission.job))
        return refuse(peer, RefusalCode::conflict, "this job was over, and has been forgotten",
                      submission.job);
    Job* known = job_of(submission.job);
    if (!known && submission.resume)
        known = newest_like(peer, submission);
    if (known) {
        const SubmitJob& s = known->submission();
        SubmitJob as_known = submission;
        as_known.priority = s.priority; // somebody may have set another one
        const bool same = submission.resume
                              ? s.scene == submission.scene && s.settings == submission.settings
                              : s == as_known;
        if (!same || is_order(*known))
            return refuse(peer, RefusalCode::conflict, "another job has this id", submission.job);
        if (submission.resume &&
            (known->phase == JobPhase::failed || known->phase == JobPhase::cancelled))
            return control_job(peer, {known->id(), JobDeed::retry, 0});
        send(peer, state_of(*known));
        if (known->phase == JobPhase::waiting_for_scene) { // its client came back
            known->set_client(peer);
            if (!known->is_being_kept)
                ask_for_scene(*known);
        }
        return;
    }
    if (const auto refused = objection(submission))
        return send(peer, *refused);
    if (!store_trouble_.empty())
        return refuse(peer, RefusalCode::limit_exceeded,
                      "this broker cannot keep jobs now: " + store_trouble_, submission.job);

    Job fresh(submission, last_number_ + 1, peer);
    if (!cut_to_fit(fresh, [&] { return !objection_to_share(fresh); }))
        return refuse(peer, RefusalCode::limit_exceeded, *objection_to_share(fresh),
                      submission.job);
    (void)cut_to_fit(fresh, [&] { return room_for(fresh).has_value(); });
    const auto room = room_for(fresh);
    if (!room)
        return refuse(peer, refusal_of(room.error().code), room.error().message, submission.job);
    make_room(*room, submission);
    if (fresh.passes() < pass_count(submission.settings))
        log({.level = LogLevel::warning,
             .kind = "passes_cut",
             .subject = to_string(fresh.id()),
             .text = described(fresh) + ": of " + std::to_string(pass_count(submission.settings)) +
                     " passes there is room for " + std::to_string(fresh.passes())});
    Job& job = jobs_.emplace(submission.job, std::move(fresh)).first->second;
    job.join(party_of(job));
    job.submitted_at = job.scene_came_on_at = now_;
    job.holds_scene = true;
    job_by_number_[++last_number_] = job.id();
    if (blobs_.complete(submission.scene)) {
        keep_job(job);
        return job.acknowledged_at ? void() : send(peer, state_of(job));
    }
    send(peer, state_of(job));
    const bool somebody_sends_it = std::ranges::any_of(jobs_, [&](const auto& entry) {
        const Job& other = entry.second;
        return other.id() != job.id() && is_waiting_for_scene(other) &&
               other.submission().scene == submission.scene && other.client() != peer;
    });
    if (!somebody_sends_it)
        ask_for_scene(job);
}

/// The newest job that draws the same picture.
Job* Dispatcher::newest_like(const PeerId& peer, const SubmitJob& submission) {
    for (auto entry = job_by_number_.rbegin(); entry != job_by_number_.rend(); ++entry)
        if (Job& job = jobs_.at(entry->second); job.submission().scene == submission.scene &&
                                                job.submission().settings == submission.settings &&
                                                may_follow(peer, job))
            return &job;
    return nullptr;
}

void Dispatcher::ask_for_scene(Job& job) {
    const ContentHash& scene = job.submission().scene;
    job.scene_came_on_at = now_;
    send(job.client(), NeedChunk{scene, blobs_.wanted_offset(scene)});
}

/// The job fails for want of its scene; its client hears of it, if it is there. Another broker may
/// have it whole, as its client has gone there: then it fails nowhere else, and is forgotten here.
void Dispatcher::fail_without_scene(Job& job, const std::string& why) {
    const PeerId client = job.client();
    const JobId id = job.id();
    if (is_alone())
        end_job(job, JobPhase::failed, why);
    JobState state = state_of(job);
    state.phase = JobPhase::failed;
    state.reason = why;
    if (!is_alone())
        discard(id);
    if (clients_.contains(client))
        send(client, std::move(state));
}

/// Whoever else waits for the same one goes on with sending it.
void Dispatcher::give_up_scene(Job& job, const std::string& why) {
    const ContentHash scene = job.submission().scene;
    fail_without_scene(job, why);
    ask_others_for_scene(scene);
}

/// One of those who are here and wait for it, too.
void Dispatcher::ask_others_for_scene(const ContentHash& scene) {
    const auto heir = std::ranges::find_if(jobs_, [&](const auto& entry) {
        const Job& other = entry.second;
        return is_waiting_for_scene(other) && other.submission().scene == scene &&
               clients_.contains(other.client());
    });
    if (heir != jobs_.end())
        ask_for_scene(heir->second);
}

/// What a scene that does not come takes up, others may need.
void Dispatcher::give_up_scenes_that_do_not_come() {
    const auto is_stuck = [this](const auto& entry) {
        const Job& job = entry.second;
        return is_waiting_for_scene(job) &&
               now_ - job.scene_came_on_at > (job.is_adopted && job.client().empty()
                                                  ? limits_.partial_copy_patience
                                                  : limits_.scene_patience);
    };
    // One at a time: the next may have been asked for its scene just now.
    for (auto stuck = jobs_.end(); (stuck = std::ranges::find_if(jobs_, is_stuck)) != jobs_.end();)
        give_up_scene(stuck->second, stuck->second.client().empty()
                                         ? "no broker has its scene any more"
                                         : "its client did not send the scene");
}

void Dispatcher::take_chunk(const PeerId& peer, const Chunk& chunk) {
    const auto waiting = [&](const Job& job) {
        return is_waiting_for_scene(job) && job.submission().scene == chunk.blob;
    };
    std::vector<JobId> ids;
    for (const auto& [id, job] : jobs_)
        if (waiting(job))
            ids.push_back(id);
    // A stranger could spoil what somebody else sends.
    const bool asked =
        std::ranges::any_of(ids, [&](const JobId& id) { return jobs_.at(id).client() == peer; });
    switch (asked ? blobs_.add(chunk) : BlobStore::Arrival::ignored) {
    case BlobStore::Arrival::more:
        for (const JobId& id : ids)
            jobs_.at(id).scene_came_on_at = now_;
        send(peer, NeedChunk{chunk.blob, blobs_.wanted_offset(chunk.blob)});
        return;
    case BlobStore::Arrival::complete:
        return begin_jobs_of(chunk.blob);
    case BlobStore::Arrival::wrong_hash:
        for (const JobId& id : ids)
            if (Job* job = job_of(id); job && job->client() == peer)
                fail_without_scene(*job,
                                   "the scene that was sent does not have the announced hash");
        for (const JobId& id : ids)
            if (Job* job = job_of(id); job && is_waiting_for_scene(*job))
                return ask_for_scene(*job);
        return;
    case BlobStore::Arrival::ignored:
        ++counters_.unexpected;
        return;
    }
}

/// One that has been acquired comes from elsewhere, perhaps while a client is sending it.
void Dispatcher::bring_scene(const ContentHash& scene, const Blob& bytes) {
    if (blobs_.complete(scene))
        return;
    blobs_.restore(scene, bytes);
    begin_jobs_of(scene);
}

/// Their scene is here, whoever has brought it.
void Dispatcher::begin_jobs_of(const ContentHash& scene) {
    for (auto& [id, job] : jobs_)
        if (is_waiting_for_scene(job) && job.submission().scene == scene)
            keep_job(job);
}

void Dispatcher::give_chunk(const PeerId& peer, WorkerSession& worker, const NeedChunk& need) {
    worker.moved_at = now_;
    for (auto& [key, grant] : worker.grants)
        if (const Job* job = job_of(key.job); job && job->submission().scene == need.blob)
            grant.progress_at = now_; // it is not stuck, but fetches
    if (auto chunk = blobs_.chunk(need.blob, need.offset_bytes))
        return send(peer, std::move(*chunk));
    refuse(peer, RefusalCode::invalid,
           "there is no chunk of " + to_string(need.blob) + " at " +
               std::to_string(need.offset_bytes));
}

/// What its parts cost is worth knowing where it can be cut, or is dealt out by that.
void Dispatcher::want_probe(Job& job) {
    const SubmitJob& s = job.submission();
    if (job.costs().is_blank() && !s.settings.limited_in_time() &&
        (s.tile_side == 0 || s.wishes.schedule == Schedule::weighted))
        job.probe = Job::Probe::wanted;
}

void Dispatcher::acknowledge(Job& job) {
    job.phase = JobPhase::queued;
    job.acknowledged_at = now_;
    counters_.jobs_acknowledged += job.is_adopted ? 0 : 1;
    set_deadline(job);
    const SubmitJob& s = job.submission();
    want_probe(job);
    look_ready(job);
    log({.level = LogLevel::info,
         .kind = "job_queued",
         .subject = to_string(job.id()),
         .text =
             described(job) + ": " + counted(s.settings.crop.pixel_count(), "pixel") + " queued"});
    publish_state(job);
}

void Dispatcher::find_job(const PeerId& peer, const FindJob& find) {
    const std::string& what = find.what;
    std::vector<const Job*> found;
    const auto numbered = [&](std::string_view digits) -> const Job* {
        const auto number = parse_count(digits);
        const auto entry = number && *number <= UINT32_MAX
                               ? job_by_number_.find(static_cast<std::uint32_t>(*number))
                               : job_by_number_.end();
        return entry == job_by_number_.end() ? nullptr : &jobs_.at(entry->second);
    };
    if (what.starts_with('#')) {
        if (const Job* const job = numbered(std::string_view(what).substr(1)))
            found.push_back(job);
    } else if (what.empty()) {
        if (!job_by_number_.empty())
            found.push_back(&jobs_.at(job_by_number_.rbegin()->second));
    } else {
        // A name means the newest job of that name; it goes before a prefix of an id.
        for (const auto& [number, id] : job_by_number_)
            if (const Job& job = jobs_.at(id); job.submission().job_name == what)
                found = {&job};
        if (found.empty())
            for (const auto& [id, job] : jobs_)
                if (!is_order(job) && to_string(id).starts_with(what))
                    found.push_back(&job);
        // Whoever types 13 has read that in a table, as #13.
        if (const Job* const job = numbered(what);
            job && std::ranges::find(found, job) == found.end())
            found.push_back(job);
    }
    if (found.empty())
        return refuse(peer, RefusalCode::no_such_job,
                      what.empty() ? "there is no job" : "there is no job '" + what + "'");
    if (found.size() > 1)
        return refuse(peer, RefusalCode::invalid,
                      "'" + what + "' fits " + std::to_string(found.size()) +
                          " jobs: give more of the id" +
                          (numbered(what) ? ", or '#" + what + "'" : ""));
    if (!may_follow(peer, *found.front()))
        return refuse(peer, RefusalCode::no_such_job, std::string(cannot_follow));
    send(peer, state_of(*found.front()));
}

/// Of a job with a time limit, when it is wanted: once, as long as it is the same.
void Dispatcher::set_deadline(const Job& job) {
    if (const PictureSettings& s = job.submission().settings; s.limited_in_time())
        deadlines_.emplace(job.submitted_at + s.time_limit, job.id());
}

/// Before it is submitted at another time, and when it is over.
void Dispatcher::clear_deadline(const Job& job) {
    deadlines_.erase({job.submitted_at + job.submission().settings.time_limit, job.id()});
}

/// The pictures of jobs with a time limit are as good as they get.
void Dispatcher::end_jobs_whose_time_is_up() {
    while (!deadlines_.empty() && deadlines_.begin()->first <= now_) {
        const auto found = jobs_.find(deadlines_.begin()->second);
        deadlines_.erase(deadlines_.begin());
        FRAJA_ASSERT(found != jobs_.end() && !is_over(found->second.phase));
        Job& job = found->second;
        job.set_time_is_up();
        look_ready(job);
        if (job.all_done())
            end_job(job, JobPhase::done, "");
        else
            log({.level = LogLevel::info,
                 .kind = "job_late",
                 .subject = to_string(job.id()),
                 .text = described(job) + ": its time is up before its first pass is done"});
    }
}

/// It is in that phase then, and nothing of it is handed out, or wanted of workers, any more.
void Dispatcher::withdraw(Job& job, JobPhase phase) {
    const std::vector<Job::Unwanted> assigned = job.drop_unfinished();
    job.phase = phase;
    look_ready(job);
    clear_deadline(job);
    cancel_unwanted(job, assigned);
}

/// An order is no more after that.
void Dispatcher::end_job(Job& job, JobPhase phase, const std::string& reason, FailureCode fault) {
    const bool was_waiting = job.phase == JobPhase::waiting_for_scene;
    withdraw(job, phase);
    if (phase == JobPhase::done)
        job.drop_checks();
    job.reason = clipped(reason, string_bytes_max); // a worker's own words may be in it
    job.over_at = now_;
    job.done_in = heeded_term_.counter;
    // It takes no scene to be over, and its tiles may still come from other brokers.
    if (was_waiting && !is_alone() && !is_order(job))
        keep_job(job);
    if (is_order(job))
        return end_order(job, phase, fault);
    keep_phase(job);
    const auto state = state_of(job);
    const bool failed = phase == JobPhase::failed, done = phase == JobPhase::done;
    ++(done ? counters_.jobs_done : failed ? counters_.jobs_failed : counters_.jobs_cancelled);
    log({.level = failed ? LogLevel::warning : LogLevel::info,
         .kind = done     ? "job_done"
                 : failed ? "job_failed"
                          : "job_cancelled",
         .subject = to_string(job.id()),
         .text = described(job) +
                 (done     ? " is done"
                  : failed ? " failed: " + job.reason
                           : " was cancelled") +
                 " after " + format_duration(state.elapsed)});
    publish_state(job);
    const auto over =
        std::ranges::count_if(jobs_, [](const auto& j) { return is_over(j.second.phase); });
    if (static_cast<std::size_t>(over) > limits_.finished_jobs_max)
        for (const auto& [number, id] : job_by_number_)
            if (is_over(jobs_.at(id).phase) && id != job.id()) {
                forget(JobId(id));
                break;
            }
}

void Dispatcher::forget(JobId id) {
    if (jobs_.at(id).is_kept)
        persist(ForgetJob{id}, {.job = id});
    if (!follows_)
        tell_all(JobForgotten{id});
    bury(id);
    discard(id);
}

/// Without a trace: of one that was never kept, it comes again from whoever has it.
void Dispatcher::discard(JobId id) {
    Job& job = jobs_.at(id);
    if (!is_over(job.phase)) // it goes on here, and is over and forgotten elsewhere
        withdraw(job, JobPhase::cancelled);
    if (job.holds_scene)
        blobs_.release(job.submission().scene);
    job_by_number_.erase(job.number());
    const FilmId film = job.submission().wishes.film;
    jobs_.erase(id);
    if (const auto found = films_.find(film); found != films_.end() && found->second.expired()) {
        films_.erase(found);
        for (auto& [peer, worker] : workers_)
            worker.frames.erase(film);
    }
}

} // namespace fraja::broker
