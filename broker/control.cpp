// Dispatcher: what people want of jobs and workers, and what becomes of workers that fail.
#include "broker/dispatcher.hpp"

#include "common/base/text.hpp"
#include "common/protocol/limits.hpp"

#include <algorithm>
#include <utility>

namespace fraja::broker {

using namespace protocol;

// -------------------------------------------------------------------------------------------- jobs

std::optional<std::string> Dispatcher::pause(Job& job) {
    if (job.phase == JobPhase::paused)
        return std::nullopt;
    if (job.phase != JobPhase::queued && job.phase != JobPhase::running)
        return "only a job that is queued or running can be paused";
    job.phase = JobPhase::paused;
    keep_phase(job);
    look_ready(job);
    log_deed(job, JobDeed::pause);
    return std::nullopt;
}

std::optional<std::string> Dispatcher::resume(Job& job) {
    if (job.may_run())
        return std::nullopt;
    if (job.phase != JobPhase::paused)
        return "only a job that is paused can be resumed";
    if (job.is_partial_copy())
        return job.reason;
    job.phase = job.in_flight_count() > 0 ? JobPhase::running : JobPhase::queued;
    keep_phase(job);
    look_ready(job);
    log_deed(job, JobDeed::resume);
    return std::nullopt;
}

/// To the broker's limits it is a new job.
std::optional<Refused> Dispatcher::retry(Job& job) {
    const auto refused = [&](RefusalCode code, std::string reason) {
        return Refused{code, job.id(), std::move(reason)};
    };
    if (job.phase != JobPhase::failed && job.phase != JobPhase::cancelled)
        return refused(RefusalCode::invalid,
                       "only a job that failed or was cancelled can be tried again");
    if (job.distrusted().size() >= distrusted_max) // it may have tiles of one more
        return refused(RefusalCode::limit_exceeded,
                       std::to_string(distrusted_max) +
                           " workers have answered wrong pixels for it: submit it again");
    if (!job.acknowledged_at || !job.holds_scene || !blobs_.complete(job.submission().scene))
        return refused(RefusalCode::invalid, "its scene is not here: submit it again");
    if (const auto full = objection_to_one_more())
        return refused(RefusalCode::limit_exceeded, *full);
    if (const auto full = objection_to_share(job))
        return refused(RefusalCode::limit_exceeded, *full);
    const auto room = room_for(job);
    if (!room)
        return refused(RefusalCode::limit_exceeded, room.error().message);
    for (const JobId& id : *room)
        forget(id);
    job.acknowledged_at = now_ - (*job.over_at - *job.acknowledged_at);
    job.over_at.reset();
    job.reason.clear();
    job.scene_fault_found_by.reset();
    job.phase = JobPhase::queued;
    job.revive();
    if (job.probe == Job::Probe::in_flight) // nobody listened when it came
        job.probe = Job::Probe::wanted;
    job.submitted_at = now_;
    if (job.is_kept) // it was copied without its scene, perhaps, which has come from elsewhere now
        persist(PutBlob{job.submission().scene, blobs_.chunks(job.submission().scene)},
                {.job = job.id()});
    keep_phase(job);
    set_deadline(job);
    look_ready(job);
    log_deed(job, JobDeed::retry);
    return std::nullopt;
}

/// A copy of a job that is over has no scene. A broker that has it tells of the job that is tried
/// again, and gives the scene.
bool Dispatcher::ask_others_to_retry(Job& job, const PeerId& peer) {
    if (peer.empty() || membership_.here(now_).empty()) // empty: it is another broker that asks
        return false;
    job.retried_by = peer;
    job.retry_until = now_ + limits_.copy_patience;
    tell_all(ControlJob{job.id(), JobDeed::retry, 0});
    return true;
}

void Dispatcher::log_deed(const Job& job, JobDeed deed) {
    const std::string done = deed == JobDeed::pause    ? "is paused"
                             : deed == JobDeed::resume ? "goes on"
                             : deed == JobDeed::retry
                                 ? "is tried again"
                                 : "has priority " + std::to_string(job.priority);
    log({.level = LogLevel::info,
         .kind = "job_controlled",
         .subject = to_string(job.id()),
         .text = described(job) + " " + done});
}

void Dispatcher::set_priority(Job& job, std::int32_t priority) {
    job.priority = priority;
    look_ready(job);
    log_deed(job, JobDeed::set_priority);
    note_change(job);
    if (job.is_kept)
        persist(PutPriority{job.id(), job.priority, job.revision}, {.job = job.id()});
}

void Dispatcher::control_job(const PeerId& peer, const ControlJob& control) {
    Job* job = job_of(control.job);
    if (!job || is_order(*job))
        return refuse(peer, RefusalCode::no_such_job, "there is no such job", control.job);
    // What cannot be written yet waits in memory, and people may ask for much; but once a job may
    // be ended.
    if (unstored_.size() >= limits_.unstored_writes_max && job->is_kept &&
        control.deed != JobDeed::cancel)
        return refuse(peer, RefusalCode::limit_exceeded,
                      "this broker has too much that it cannot keep yet" +
                          (store_trouble_.empty() ? "" : ": " + store_trouble_),
                      control.job);
    std::optional<std::string> objection;
    switch (control.deed) {
    case JobDeed::cancel:
        if (!is_over(job->phase))
            end_job(*job, JobPhase::cancelled, "cancelled by a client");
        return send(peer, state_of(*job));
    case JobDeed::pause:
        objection = pause(*job);
        break;
    case JobDeed::resume:
        objection = resume(*job);
        break;
    case JobDeed::retry:
        if (job->retried_by && now_ < job->retry_until) {
            job->retried_by = peer;
            return;
        }
        if (!std::exchange(job->retried_by, std::nullopt) && !job->holds_scene &&
            is_over(job->phase)) {
            if (job->is_kept)
                return actions_->push_back(LoadScene{job->id(), job->submission().scene, peer});
            if (ask_others_to_retry(*job, peer))
                return;
        }
        if (const auto refused = retry(*job))
            return send(peer, *refused);
        end_if_done(*job);
        break;
    case JobDeed::set_priority:
        set_priority(*job, control.priority);
        break;
    }
    if (objection)
        return refuse(peer, RefusalCode::invalid, *objection, control.job);
    publish_state(*job);
    send(peer, state_of(*job));
}

// ----------------------------------------------------------------------------------------- workers

/// Does something that changes how many tiles a worker may have.
void Dispatcher::change_room(const PeerId& peer, WorkerSession& worker, const auto& deed) {
    const auto threads = [&] { return worker.room() > 0 ? worker.hello.threads : 0; };
    const bool had_room = worker.room() > 0;
    workers_with_credit_ -= had_room;
    threads_with_credit_ -= threads();
    deed();
    workers_with_credit_ += worker.room() > 0;
    threads_with_credit_ += threads();
    count_capacity(worker);
    update_load(peer, worker);
    if (had_room && worker.room() == 0)
        release_shares(worker.hello.worker);
}

/// What was dealt out to whoever gets nothing any more is anybody's.
void Dispatcher::release_shares(const WorkerId& worker) {
    for (auto& [id, job] : jobs_)
        if (job.is_dealt_out()) {
            job.release_share(worker);
            look_ready(job);
        }
}

void Dispatcher::count_capacity(WorkerSession& worker) {
    const double now = worker.room() > 0 ? speed_of(worker) * worker.hello.threads : 0;
    capacity_ += now - worker.capacity;
    worker.capacity = now;
}

/// Next to what somebody claims to be able to do, what all others can may be less than a rounding:
/// it would be lost with whoever claimed that.
void Dispatcher::add_up_capacity() {
    capacity_ = 0;
    for (const auto& [peer, worker] : workers_)
        capacity_ += worker.capacity;
}

void Dispatcher::set_credit(const PeerId& peer, WorkerSession& worker, std::uint32_t credit) {
    change_room(peer, worker, [&] { worker.credit = credit; });
}

void Dispatcher::set_tells_by(const PeerId& peer, WorkerSession& worker,
                              std::optional<Instant> tells_by) {
    change_room(peer, worker, [&] { worker.tells_by = tells_by; });
}

namespace {

/// Of workers, or of workers that are gone: those of that name, or else whose ids begin like that.
template <class Map, class SessionOf>
std::vector<typename Map::iterator> find_workers(Map& workers, const std::string& what,
                                                 SessionOf session_of) {
    std::vector<typename Map::iterator> found;
    for (auto worker = workers.begin(); worker != workers.end(); ++worker)
        if (session_of(worker->second).hello.worker_name == what)
            found.push_back(worker);
    if (found.empty() && !what.empty())
        for (auto worker = workers.begin(); worker != workers.end(); ++worker)
            if (to_string(session_of(worker->second).hello.worker).starts_with(what))
                found.push_back(worker);
    return found;
}

} // namespace

void Dispatcher::control_worker(const PeerId& peer, const ControlWorker& control) {
    const auto found = find_workers(
        workers_, control.what, [](auto& session) -> auto& { return session; });
    if (found.empty() && control.deed == WorkerDeed::undrain)
        return undrain_absent(peer, control.what);
    if (!is_one(peer, found.size(), control.what))
        return;
    const PeerId worker_peer = found.front()->first;
    WorkerSession& worker = found.front()->second;
    switch (control.deed) {
    case WorkerDeed::drain:
        change_room(worker_peer, worker, [&] { worker.drained = true; });
        log({.level = LogLevel::info,
             .kind = "worker_drained",
             .subject = worker.hello.worker_name,
             .text = "worker " + worker.hello.worker_name + " is drained"});
        break;
    case WorkerDeed::undrain:
        change_room(worker_peer, worker, [&] { undrain(worker); });
        log({.level = LogLevel::info,
             .kind = "worker_undrained",
             .subject = worker.hello.worker_name,
             .text = "worker " + worker.hello.worker_name + " gets tiles again"});
        break;
    case WorkerDeed::kick:
        break;
    }
    if (!follows_) {
        send(peer, FarmState{term().counter, {}, {worker_state(worker)}, {}});
        tell_all(ControlWorker{to_string(worker.hello.worker), control.deed});
    }
    if (control.deed == WorkerDeed::kick) {
        send(worker_peer, Dismissed{"dismissed by a client"});
        end_worker(workers_.find(worker_peer), Departure::said_goodbye, "it was dismissed");
    }
}

/// Whether there is one, and no more; or else the peer is told.
bool Dispatcher::is_one(const PeerId& peer, std::size_t found, const std::string& what) {
    if (found == 0)
        refuse(peer, RefusalCode::no_such_worker, "there is no worker '" + what + "'");
    else if (found > 1)
        refuse(peer, RefusalCode::invalid,
               "'" + what + "' fits " + std::to_string(found) + " workers: give more of the id");
    return found == 1;
}

void Dispatcher::undrain(WorkerSession& worker) {
    worker.drained = false;
    worker.quarantined_until.reset();
    worker.failures.clear();
    if (!worker.distrusted.empty())
        pardon(worker.drawer);
    worker.distrusted.clear();
}

/// For when it comes back. Of several processes of that name, which may have been started one after
/// the other, any.
void Dispatcher::undrain_absent(const PeerId& peer, const std::string& what) {
    const auto found = find_workers(
        absent_, what, [](auto& absent) -> auto& { return absent.session; });
    const bool is_name = !found.empty() && found.front()->second.session.hello.worker_name == what;
    if (!is_one(peer, is_name ? 1 : found.size(), what))
        return;
    for (const auto& absent : found)
        undrain(absent->second.session);
    const WorkerSession& worker = found.front()->second.session;
    log({.level = LogLevel::info,
         .kind = "worker_undrained",
         .subject = worker.hello.worker_name,
         .text = "worker " + worker.hello.worker_name + " gets tiles again when it comes back"});
    send(peer, FarmState{term().counter, {}, {worker_state(worker)}, {}});
    if (!follows_)
        tell_all(ControlWorker{to_string(worker.hello.worker), WorkerDeed::undrain});
}

/// Too many within a while, and it gets nothing for as long; but for the last one that there is.
void Dispatcher::count_machine_failure(const PeerId& peer, WorkerSession& worker) {
    worker.failures.push_back(now_);
    while (now_ - worker.failures.front() > limits_.quarantine_window)
        worker.failures.pop_front();
    if (worker.failures.size() < limits_.quarantine_failures || worker.quarantined_until ||
        workers_with_credit_ - (worker.room() > 0) == 0)
        return;
    change_room(peer, worker, [&] { worker.quarantined_until = now_ + limits_.quarantine_window; });
    ++counters_.workers_quarantined;
    log({.level = LogLevel::warning,
         .kind = "worker_quarantined",
         .subject = worker.hello.worker_name,
         .text = "worker " + worker.hello.worker_name + " has failed " +
                 counted(worker.failures.size(), "tile") + ": it gets none for " +
                 format_duration(limits_.quarantine_window)});
}

/// Gets nothing any more, even if it is the last one: no picture is better than a wrong one.
void Dispatcher::give_no_more(const PeerId& peer, WorkerSession& worker, const std::string& why) {
    if (!worker.distrusted.empty())
        return;
    change_room(peer, worker, [&] { worker.distrusted = why; });
    ++counters_.workers_distrusted;
    log({.level = LogLevel::error,
         .kind = "worker_distrusted",
         .subject = worker.hello.worker_name,
         .text = "worker " + worker.hello.worker_name + " " + to_string(worker.hello.worker) +
                 (worker.holder ? ", which has the key of " + worker.holder->name + "," : "") +
                 " answers wrong pixels (" + why +
                 "): it gets no tiles until somebody takes it back (fraja-ctl undrain)"});
    std::vector<GrantKey> keys;
    for (const auto& [key, grant] : worker.grants)
        keys.push_back(key);
    for (const GrantKey& key : keys) {
        const Grant grant = worker.grants.at(key);
        cancel_grant(peer, key);
        (void)take_back(key, grant, false, worker, "its pixels are wrong");
    }
}

void Dispatcher::end_quarantines() {
    // The others have gone: better a bad worker than none.
    const bool nobody_else = workers_with_credit_ == 0;
    for (auto& [peer, worker] : workers_)
        if (worker.quarantined_until && (nobody_else || now_ >= *worker.quarantined_until)) {
            change_room(peer, worker, [&worker = worker] {
                worker.quarantined_until.reset();
                worker.failures.clear();
            });
            log({.level = LogLevel::info,
                 .kind = "quarantine_over",
                 .subject = worker.hello.worker_name,
                 .text = "worker " + worker.hello.worker_name + " gets tiles again" +
                         (nobody_else ? ": there is no other" : "")});
        }
}

} // namespace fraja::broker
