// Dispatcher: what is to be done.
#include "broker/dispatcher.hpp"
#include "broker/tile_plan.hpp"
#include "common/base/text.hpp"
#include "common/protocol/limits.hpp"
#include "common/protocol/passes.hpp"

#include <algorithm>

namespace fraja::broker {

using namespace protocol;

namespace {

std::string described(const Job& job) {
    return "job #" + std::to_string(job.number()) + " " + job.submission().job_name + " " +
           to_string(job.id());
}

/// 0: as there are.
std::uint64_t cell_count(const SubmitJob& s) {
    const std::uint32_t side = s.tile_side > 0 ? s.tile_side : automatic_cell_side(s.settings);
    return cells_of(s.settings.crop, side).pixel_count() * pass_count(s.settings);
}

/// And not for the store to have it.
bool is_waiting_for_scene(const Job& job) {
    return job.phase == JobPhase::waiting_for_scene && !job.is_being_kept;
}

bool is_tag(const std::string& tag) {
    return !tag.empty() && tag.size() <= name_bytes_max;
}

} // namespace

std::optional<Refused> Dispatcher::objection(const SubmitJob& s) const {
    const auto refused = [&](RefusalCode code, std::string reason) {
        return Refused{code, s.job, std::move(reason)};
    };
    if (const auto valid = validate(s.settings); !valid)
        return refused(RefusalCode::invalid, valid.error().message);
    if (s.job == JobId{})
        return refused(RefusalCode::invalid, "the job's id is zero");
    if (s.job_name.size() > name_bytes_max)
        return refused(RefusalCode::invalid,
                       "a job's name has at most " + std::to_string(name_bytes_max) + " bytes");
    if (s.scene_bytes == 0 || s.scene_bytes > scene_bytes_max)
        return refused(RefusalCode::invalid,
                       "a scene has 1 to " + std::to_string(scene_bytes_max) + " bytes");
    if (s.tile_side > tile_side_max)
        return refused(RefusalCode::invalid,
                       "a tile's side is at most " + std::to_string(tile_side_max) + " pixels");
    if (cell_count(s) > cells_per_job_max)
        return refused(RefusalCode::invalid,
                       "a job has at most " + std::to_string(cells_per_job_max) + " tiles");
    if (s.wishes.tags.size() > tags_max || !std::ranges::all_of(s.wishes.tags, is_tag))
        return refused(RefusalCode::invalid, "a job has at most " + std::to_string(tags_max) +
                                                 " tags of 1 to " + std::to_string(name_bytes_max) +
                                                 " bytes");
    if (const auto why = objection_to_frame(s))
        return refused(RefusalCode::invalid, *why);
    if (s.wishes.schedule != Schedule::demand) {
        if (s.settings.limited_in_time())
            return refused(RefusalCode::invalid,
                           "a picture with a time limit is dealt out on demand");
        if (s.tile_side > 0 && cell_count(s) > limits_.dealt_cells_max)
            return refused(RefusalCode::invalid, "at most " +
                                                     std::to_string(limits_.dealt_cells_max) +
                                                     " tiles are dealt out at once");
    }
    if (const auto full = objection_to_one_more())
        return refused(RefusalCode::limit_exceeded, *full);
    return std::nullopt;
}

std::optional<std::string> Dispatcher::objection_to_one_more() const {
    const auto live = std::ranges::count_if(job_by_number_, [this](const auto& entry) {
        return !is_over(jobs_.at(entry.second).phase);
    });
    if (static_cast<std::size_t>(live) >= limits_.jobs_max)
        return "this broker takes " + std::to_string(limits_.jobs_max) + " jobs at a time";
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

std::optional<std::string> Dispatcher::objection_to_size(const Job& wanted) const {
    std::uint64_t stored = wanted.promised_bytes();
    for (const auto& [id, job] : jobs_)
        if (id != wanted.id())
            stored += job.stored_bytes();
    if (stored > limits_.stored_bytes_max)
        return "this broker stores pictures of at most " +
               std::to_string(limits_.stored_bytes_max) + " bytes";
    return std::nullopt;
}

/// What is over makes room for what is to come. False: there is nothing but `wanted`.
bool Dispatcher::forget_oldest_but(const JobId& wanted) {
    const auto oldest = std::ranges::find_if(job_by_number_, [&](const auto& entry) {
        return entry.second != wanted && is_over(jobs_.at(entry.second).phase);
    });
    if (oldest == job_by_number_.end())
        return false;
    forget(JobId(oldest->second));
    return true;
}

std::optional<std::string> Dispatcher::objection_to_frame(const SubmitJob& s) const {
    const Wishes& wishes = s.wishes;
    if ((wishes.film == FilmId{}) != (wishes.frame == 0))
        return wishes.frame == 0 ? "a film's frames count from 1"
                                 : "a picture that is of no film has no number in one";
    if (wishes.film == FilmId{})
        return std::nullopt;
    if (wishes.schedule != Schedule::demand)
        return "a film's frames are dealt out on demand";
    if (s.settings.limited_in_time())
        return "a film's frames have no time limit";
    const auto found = films_.find(wishes.film);
    if (found != films_.end()) {
        Wishes others = found->second.lock()->wishes();
        others.frame = wishes.frame;
        if (others != wishes)
            return "the film's other frames have other wishes";
    }
    return std::nullopt;
}

/// Its film's, or its own.
std::shared_ptr<Party> Dispatcher::party_of(const Job& job) {
    const Wishes& wishes = job.submission().wishes;
    if (wishes.film == FilmId{})
        return std::make_shared<Party>(job.number(), wishes);
    std::weak_ptr<Party>& film = films_[wishes.film];
    std::shared_ptr<Party> party = film.lock();
    if (!party)
        film = party = std::make_shared<Party>(job.number(), wishes);
    return party;
}

void Dispatcher::submit(const PeerId& peer, const SubmitJob& submission) {
    if (forgotten_.contains(submission.job))
        return refuse(peer, RefusalCode::conflict, "this job was over, and has been forgotten",
                      submission.job);
    Job* known = job_of(submission.job);
    if (!known && submission.resume)
        known = newest_like(submission);
    if (known) {
        const SubmitJob& s = known->submission();
        const bool same = submission.resume
                              ? s.scene == submission.scene && s.settings == submission.settings
                              : s == submission;
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
    const auto is_cut = [&fresh] {
        if (fresh.passes() == 1)
            return false;
        fresh.set_passes(fresh.passes() - 1);
        return true;
    };
    while (const auto full = objection_to_share(fresh))
        if (!is_cut())
            return refuse(peer, RefusalCode::limit_exceeded, *full, submission.job);
    const auto over_limit = [&]() -> std::optional<std::string> {
        if (auto full = objection_to_size(fresh))
            return full;
        const auto acquired = blobs_.acquire(submission.scene, submission.scene_bytes);
        return acquired ? std::nullopt : std::optional(acquired.error().message);
    };
    while (const auto full = over_limit())
        if (!forget_oldest_but(submission.job) && !is_cut())
            return refuse(peer, RefusalCode::limit_exceeded, *full, submission.job);
    if (fresh.passes() < pass_count(submission.settings))
        log(LogLevel::warning, described(fresh) + ": of " +
                                   std::to_string(pass_count(submission.settings)) +
                                   " passes there is room for " + std::to_string(fresh.passes()));
    Job& job = jobs_.emplace(submission.job, std::move(fresh)).first->second;
    job.join(party_of(job));
    job.submitted_at = job.scene_came_on_at = now_;
    job.holds_scene = true;
    job_by_number_[++last_number_] = job.id();
    if (blobs_.complete(submission.scene)) {
        keep_job(job);
        return send(peer, state_of(job));
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
Job* Dispatcher::newest_like(const SubmitJob& submission) {
    for (auto entry = job_by_number_.rbegin(); entry != job_by_number_.rend(); ++entry)
        if (Job& job = jobs_.at(entry->second); job.submission().scene == submission.scene &&
                                                job.submission().settings == submission.settings)
            return &job;
    return nullptr;
}

void Dispatcher::ask_for_scene(Job& job) {
    const ContentHash& scene = job.submission().scene;
    job.scene_came_on_at = now_;
    send(job.client(), NeedChunk{scene, blobs_.wanted_offset(scene)});
}

/// The job fails for want of its scene. Whoever else waits for the same one goes on with sending
/// it.
void Dispatcher::give_up_scene(Job& job, const std::string& why) {
    const ContentHash scene = job.submission().scene;
    end_job(job, JobPhase::failed, why);
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
        return is_waiting_for_scene(entry.second) &&
               now_ - entry.second.scene_came_on_at > limits_.scene_patience;
    };
    // One at a time: the next may have been asked for its scene just now.
    for (auto stuck = jobs_.end();
         (stuck = std::ranges::find_if(jobs_, is_stuck)) != jobs_.end();) {
        Job& job = stuck->second;
        give_up_scene(job, "its client did not send the scene");
        send(job.client(), state_of(job));
    }
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
        for (const JobId& id : ids) {
            Job& job = jobs_.at(id);
            keep_job(job);
            if (job.acknowledged_at)
                send(job.client(), state_of(job));
        }
        return;
    case BlobStore::Arrival::wrong_hash:
        for (const JobId& id : ids)
            if (Job* job = job_of(id); job && job->client() == peer) {
                end_job(*job, JobPhase::failed,
                        "the scene that was sent does not have the announced hash");
                send(peer, state_of(*job));
            }
        for (const JobId& id : ids)
            if (Job* job = job_of(id); job && is_waiting_for_scene(*job))
                return ask_for_scene(*job);
        return;
    case BlobStore::Arrival::ignored:
        ++counters_.unexpected;
        return;
    }
}

void Dispatcher::give_chunk(const PeerId& peer, const NeedChunk& need) {
    if (auto chunk = blobs_.chunk(need.blob, need.offset_bytes))
        return send(peer, std::move(*chunk));
    refuse(peer, RefusalCode::invalid,
           "there is no chunk of " + to_string(need.blob) + " at " +
               std::to_string(need.offset_bytes));
}

void Dispatcher::acknowledge(Job& job) {
    job.phase = JobPhase::queued;
    job.acknowledged_at = now_;
    if (const PictureSettings& s = job.submission().settings; s.limited_in_time())
        deadlines_.emplace(job.submitted_at + s.time_limit, job.id());
    const SubmitJob& s = job.submission();
    if (s.tile_side == 0 && !s.settings.limited_in_time())
        job.probe = Job::Probe::wanted;
    look_ready(job);
    log(LogLevel::info,
        described(job) + ": " + std::to_string(s.settings.crop.pixel_count()) + " pixel(s) queued");
    publish_state(job);
}

void Dispatcher::find_job(const PeerId& peer, const FindJob& find) {
    const std::string& what = find.what;
    std::vector<const Job*> found;
    if (what.starts_with('#')) {
        const auto number = parse_count(std::string_view(what).substr(1));
        const auto entry = number && *number <= UINT32_MAX
                               ? job_by_number_.find(static_cast<std::uint32_t>(*number))
                               : job_by_number_.end();
        if (entry != job_by_number_.end())
            found.push_back(&jobs_.at(entry->second));
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
    }
    if (found.empty())
        return refuse(peer, RefusalCode::no_such_job,
                      what.empty() ? "there is no job" : "there is no job '" + what + "'");
    if (found.size() > 1)
        return refuse(peer, RefusalCode::invalid,
                      "'" + what + "' fits " + std::to_string(found.size()) +
                          " jobs: give more of the id");
    send(peer, state_of(*found.front()));
}

/// The pictures of jobs with a time limit are as good as they get.
void Dispatcher::end_jobs_whose_time_is_up() {
    while (!deadlines_.empty() && deadlines_.begin()->first <= now_) {
        Job& job = jobs_.at(deadlines_.begin()->second);
        deadlines_.erase(deadlines_.begin());
        job.set_time_is_up();
        look_ready(job);
        if (job.all_done())
            end_job(job, JobPhase::done, "");
        else
            log(LogLevel::info, described(job) + ": its time is up before its first pass is done");
    }
}

/// An order is no more after that.
void Dispatcher::end_job(Job& job, JobPhase phase, const std::string& reason, FailureCode fault) {
    const std::vector<Job::Unwanted> assigned = job.drop_unfinished();
    job.phase = phase;
    job.reason = clipped(reason, string_bytes_max); // a worker's own words may be in it
    job.over_at = now_;
    look_ready(job);
    if (job.acknowledged_at)
        deadlines_.erase({job.submitted_at + job.submission().settings.time_limit, job.id()});
    cancel_unwanted(job, assigned);
    if (is_order(job))
        return end_order(job, phase, fault);
    keep_phase(job);
    const auto state = state_of(job);
    log(phase == JobPhase::failed ? LogLevel::warning : LogLevel::info,
        described(job) +
            (phase == JobPhase::done     ? " is done"
             : phase == JobPhase::failed ? " failed: " + job.reason
                                         : " was cancelled") +
            " after " + format_duration(state.elapsed));
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
    const Job& job = jobs_.at(id);
    if (job.holds_scene)
        blobs_.release(job.submission().scene);
    if (job.is_kept)
        persist(ForgetJob{id}, {.job = id});
    bury(id);
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
