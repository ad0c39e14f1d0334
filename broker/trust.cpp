// Dispatcher: tiles that a second worker draws as well, and what becomes of a worker whose pixels
// are wrong.
#include "broker/dispatcher.hpp"
#include "broker/id_hash.hpp"

#include "common/base/rng.hpp"
#include "common/base/text.hpp"
#include "common/protocol/content_hash.hpp"
#include "common/protocol/limits.hpp"

#include <algorithm>
#include <utility>

namespace fraja::broker {

using namespace protocol;

namespace {

constexpr std::size_t reason_bytes_max = 500;

ContentHash pixels_hash(const std::vector<Blob>& pixels) {
    ContentHasher hasher;
    for (const Blob& blob : pixels)
        hasher.add(blob);
    return hasher.finish();
}

std::string names_of(const Checks::Check& check) {
    std::vector<std::string> names;
    for (const Checks::Answer& answer : check.answers)
        if (std::ranges::find(names, answer.worker_name) == names.end())
            names.push_back(answer.worker_name);
    return comma_list(names);
}

} // namespace

// ----------------------------------------------------------------------------------------- checks

/// Whatever the order in which tiles come. Workers do not know the key: none can answer right where
/// it will be checked, and wrong elsewhere. What nobody here has given a worker may be whatever it
/// likes, of any size: it is checked, also where a share of the tiles is.
bool Dispatcher::is_to_be_checked(const Job& job, const Tile& tile, Giver giver) const {
    if (!job.is_checked() || is_order(job))
        return false;
    if (giver == Giver::unknown)
        return true;
    Rng rng(identity_.check_key ^ hash_of(job.id()));
    rng = Rng(rng.next() ^ static_cast<std::uint64_t>(job.index(tile)));
    rng = Rng(rng.next() ^ (std::uint64_t{tile.cells.width} << 32 | tile.cells.height));
    return rng.unit() < job.submission().wishes.verify;
}

void Dispatcher::want_check(Job& job, const Tile& tile, const TileDone& result, Giver giver) {
    if (is_to_be_checked(job, tile, giver))
        job.want_check(tile, {result.worker, result.worker_name, pixels_hash(result.blobs)});
}

Checks::HasOthers Dispatcher::others_for(const Job& job) const {
    return [this, &job](const Checks::Check& check) {
        return std::ranges::any_of(workers_, [&](const auto& entry) {
            const WorkerSession& worker = entry.second;
            return worker.room() > 0 && has_tags(worker, job.submission().wishes) &&
                   !job.distrusts(worker.drawer) &&
                   check.is_new_to(worker.hello.worker, worker.voter);
        });
    };
}

bool Dispatcher::grant_check(const PeerId& peer, WorkerSession& worker, Job& job) {
    if (!job.checks().has_pending())
        return false;
    const AttemptNumber attempt{attempts_ + 1};
    const auto check =
        job.assign_check(worker.hello.worker, worker.voter, {peer, attempt}, others_for(job));
    if (!check)
        return false;
    send_grant(peer, worker, job,
               Grant{.check = check->first,
                     .tile = check->second,
                     .work = job.costs().work(check->second.cells)},
               attempt);
    return true;
}

void Dispatcher::check_rendered(Job& job, WorkerSession& worker, const Grant& grant,
                                AttemptNumber attempt, const TileRendered& answer) {
    if (!job.check_assigned_as(grant.check, attempt)) {
        ++counters_.answers_unneeded;
        return;
    }
    (void)count_rendered(job, worker, now_ - grant.granted_at, answer);
    const std::uint32_t agreed = job.checks().counts().agreed;
    const std::vector<WorkerId> wrong = job.answer_check(
        grant.check, {worker.drawer, worker.hello.worker_name, pixels_hash(answer.blobs)});
    counters_.tiles_checked += job.checks().counts().agreed - agreed;
    if (const Checks::Check* check = job.checks().find(grant.check); check && !check->agrees()) {
        const std::vector<Checks::Answer> answers = check->answers;
        const std::string tile = described(job, grant.tile);
        if (wrong.empty() && answers.size() == 2) // once
            log({.level = LogLevel::warning,
                 .kind = "tile_contested",
                 .subject = to_string(job.id()),
                 .text = tile + ": workers " + names_of(*check) +
                         " have drawn different pixels; who is right is being found out"});
        std::vector<Distrusted> liars;
        for (const WorkerId& id : wrong) {
            const auto said = std::ranges::find(answers, id, &Checks::Answer::worker);
            const bool twice = std::ranges::any_of(answers, [&](const Checks::Answer& other) {
                return other.worker == id && other.pixels != said->pixels;
            });
            liars.push_back({id, said->worker_name,
                             tile + (twice ? ": it has drawn it twice, and not the same"
                                           : ": two others have drawn the same, and it has not")});
        }
        distrust(liars, answer.job);
    }
    if (Job* still = job_of(answer.job); still && !is_over(still->phase)) {
        look_ready(*still);
        end_if_done(*still);
    }
}

/// All of it is there (also of one that is tried again, as other brokers had more of it), and what
/// was to be checked is, as far as there is somebody for it: nobody is
/// waited for, but where workers disagree.
void Dispatcher::end_if_done(Job& job) {
    if (!deals_out() || !job.all_done() || is_over(job.phase))
        return;
    if (!job.checks().empty()) {
        if (!job.may_run() || job.in_flight_count() > 0)
            return;
        const std::uint32_t given_up = job.give_up_checks(others_for(job));
        if (given_up > 0)
            log({.level = LogLevel::warning,
                 .kind = "tiles_unchecked",
                 .subject = to_string(job.id()),
                 .text = described(job) + ": " + counted(given_up, "tile") +
                         " could not be checked: there is no second worker" +
                         (has_keys() ? " with another key (or of the role workers)" : "")});
        counters_.tiles_unchecked += given_up;
        look_ready(job);
        if (!job.checks().empty())
            return;
    }
    end_job(job, JobPhase::done, "");
}

/// Whoever could have checked their tiles may have gone, or is not believed any more.
void Dispatcher::end_jobs_that_are_through() {
    std::vector<JobId> waiting;
    for (const auto& [id, job] : jobs_)
        if (!is_over(job.phase) && job.all_done())
            waiting.push_back(id);
    for (const JobId& id : waiting)
        if (Job* job = job_of(id))
            end_if_done(*job);
    for (const JobId& id : waiting)
        if (Job* job = job_of(id); job && deals_out() && contest(*job) &&
                                   now_ - job->contest_asked_at >= limits_.contest_interval) {
            job->contest_asked_at = now_;
            job->forgive_failed_checks();
            look_ready(*job);
        }
}

/// Why a job of which all is drawn does not end.
std::optional<std::string> Dispatcher::contest(const Job& job) const {
    if (!job.all_done() || job.in_flight_count() > 0)
        return std::nullopt;
    const Checks::Check* check = job.checks().contested();
    if (!check)
        return std::nullopt;
    return "waiting: workers " + names_of(*check) + " have drawn different pixels (" +
           described(job, check->tile) +
           "), and it takes one more worker that may draw it to tell which are right: start one";
}

// ------------------------------------------------------------------------------------------ trust

/// They were found in that job; all others that they have drawn for must do without, too. Before
/// anything else: what is taken back from them may be the last that a job has waited for.
void Dispatcher::distrust(const std::vector<Distrusted>& liars, const JobId& found_in) {
    for (const Distrusted& who : liars)
        void_all_tiles(who, found_in);
    for (const Distrusted& who : liars)
        give_no_more(who);
    end_jobs_that_are_through();
}

/// To nobody who has that key.
void Dispatcher::give_no_more(const Distrusted& who) {
    pardoned_.erase(who.worker);
    if (liars_.size() < limits_.liars_max)
        liars_.emplace(who.worker, who.reason);
    for (auto& [peer, worker] : workers_)
        if (worker.drawer == who.worker)
            give_no_more(peer, worker, who.reason);
}

/// What is missing can be drawn again. One that failed or was cancelled may be tried again.
bool Dispatcher::can_do_without_tiles(const Job& job) const {
    return job.phase != JobPhase::done && !ends_as_told(job) &&
           !job.submission().settings.limited_in_time();
}

void Dispatcher::void_all_tiles(const Distrusted& who, const JobId& found_in) {
    std::vector<JobId> concerned;
    for (const auto& [id, job] : jobs_) {
        if (job.distrusts(who.worker) || (id != found_in && !job.has_tiles_of(who.worker)))
            continue;
        if (can_do_without_tiles(job))
            concerned.push_back(id);
        else
            tell_doubt(job, who);
    }
    for (const JobId& id : concerned)
        if (Job* job = job_of(id); job && job->phase != JobPhase::done)
            void_tiles(*job, who);
}

void Dispatcher::tell_doubt(const Job& job, const Distrusted& who) {
    log({.level = LogLevel::warning,
         .kind = "tiles_in_doubt",
         .subject = to_string(job.id()),
         .text = described(job) + " has tiles of worker " + who.worker_name +
                 ", which has answered wrong pixels elsewhere: submit it again"});
}

void Dispatcher::void_tiles(Job& job, const Distrusted& who) {
    if (job.distrusted().size() >= distrusted_max)
        return is_over(job.phase) ? void()
                                  : end_job(job, JobPhase::failed,
                                            "more than " + std::to_string(distrusted_max) +
                                                " workers have answered wrong pixels");
    const Distrusted named{who.worker, std::string(clipped(who.worker_name, name_bytes_max)),
                           std::string(clipped(who.reason, reason_bytes_max))};
    const Job::Voided voided = job.distrust(named);
    cancel_unwanted(job, voided.unwanted);
    if (!is_over(job.phase)) // or it would go before somebody's wish to have it tried again
        note_change(job);
    if (!voided.tiles.empty())
        log({.level = LogLevel::warning,
             .kind = "tiles_voided",
             .subject = to_string(job.id()),
             .text = described(job) + ": " + counted(voided.tiles.size(), "tile") + " of worker " +
                     who.worker_name + " do not count"});
    keep_voided(job, named, voided.tiles);
    look_ready(job);
    tell_changes(); // before anybody else hears of it
    publish_state(job);
}

void Dispatcher::keep_voided(const Job& job, const Distrusted& who,
                             const std::vector<Tile>& tiles) {
    if (!job.is_kept)
        return;
    PutDistrusted put{job.id(), who, {}, job.revision};
    for (const Tile& tile : tiles) {
        const PixelRect r = job.rect(tile);
        put.tiles.push_back({job.index(tile), {r.width, r.height}});
    }
    persist(std::move(put), {.job = job.id()});
}

/// Another broker has found them out. What they have drawn for other jobs may have come here alone.
/// Whether some of them were not known here.
bool Dispatcher::take_distrusted(const JobId& id, const std::vector<Distrusted>& theirs) {
    bool is_news = false;
    for (const Distrusted& who : theirs) {
        Job* job = job_of(id);
        if (!job || job->phase == JobPhase::done || ends_as_told(*job) ||
            job->distrusts(who.worker) || job->distrusted().size() >= distrusted_max)
            continue;
        is_news = true;
        {
            const Following following(follows_);
            void_tiles(*job, who);
        }
        distrust({who}, id);
    }
    return is_news;
}

/// It is done elsewhere, and its picture told, with tiles of workers that were not known for what
/// they are there: this broker has it as it is.
void Dispatcher::trust_as_told(Job& job) {
    for (const Distrusted& who : std::vector(job.distrusted())) {
        if (std::ranges::find(job.awaited->distrusted, who.worker, &Distrusted::worker) !=
            job.awaited->distrusted.end())
            continue;
        job.trust(who.worker);
        tell_doubt(job, who);
        if (job.is_kept)
            persist(PutTrusted{job.id(), who.worker}, {.job = job.id()});
    }
}

/// Of jobs that were to end as another broker had told, and go on here after all: what workers have
/// drawn that are known for what they are.
void Dispatcher::void_again() {
    std::vector<Distrusted> known;
    for (const auto& [peer, worker] : workers_)
        if (!worker.distrusted.empty())
            known.push_back({worker.drawer, worker.hello.worker_name, worker.distrusted});
    for (const auto& [id, absent] : absent_)
        if (!absent.session.distrusted.empty())
            known.push_back({absent.session.drawer, absent.session.hello.worker_name,
                             absent.session.distrusted});
    for (const Distrusted& who : known) {
        std::vector<JobId> concerned;
        for (const auto& [id, job] : jobs_)
            if (can_do_without_tiles(job) && !job.distrusts(who.worker) &&
                job.has_tiles_of(who.worker))
                concerned.push_back(id);
        for (const JobId& id : concerned)
            if (Job* job = job_of(id))
                void_tiles(*job, who);
    }
}

/// A job that is to be checked has of other brokers only what the one that leads has. What that one
/// has not come to check is in doubt when another begins to lead.
void Dispatcher::heed_new_term() {
    if (term() == heeded_term_)
        return;
    heeded_term_ = term();
    if (identity_.keeps && !is_alone())
        persist(PutTerm{term().counter}, {});
    for (auto& [id, job] : jobs_) {
        if (!job.is_checked() || job.phase == JobPhase::done)
            continue;
        job.leader_agrees = false;
        if (job.awaited && job.holds_scene && job.awaited->phase == JobPhase::done)
            job.awaited.reset(); // whoever still has come to that end says so again
        if (membership_.leads() || job.checks().empty())
            continue;
        const Job::Voided voided = job.void_unchecked();
        cancel_unwanted(job, voided.unwanted);
        keep_voided(job, {}, voided.tiles);
        look_ready(job);
    }
}

/// Word of a new term may come by another way than what its leader said in one of before.
bool Dispatcher::leads_in(std::uint64_t epoch, const BrokerId& broker) const {
    return broker == term().leader && epoch == term().counter;
}

bool Dispatcher::may_take_tiles(const Job& job, const BrokerId& from, std::uint64_t epoch) const {
    return !job.is_checked() || membership_.leads() || leads_in(epoch, from);
}

/// Whether the end that another broker tells of is one that the tiles here have come to as well.
bool Dispatcher::is_checked_as_told(const Job& job) const {
    if (!job.is_checked())
        return true;
    return membership_.leads() ? job.checks().empty() || !job.holds_scene : job.leader_agrees;
}

/// It ends here, too, with the tiles that the broker has that has told of its end. Whoever leads
/// and has its scene comes to an end of its own.
bool Dispatcher::ends_as_told(const Job& job) const {
    if (!job.awaited || job.awaited->phase != JobPhase::done || job.phase == JobPhase::done)
        return false;
    return membership_.leads() ? !job.holds_scene : is_checked_as_told(job);
}

/// Somebody has taken it back: for all who have its key, until it is found again.
void Dispatcher::pardon(const WorkerId& drawer) {
    liars_.erase(drawer);
    if (pardoned_.size() < limits_.liars_max)
        pardoned_.insert(drawer);
}

/// What is known of one that says hello: a broker that was started anew has it from its jobs.
void Dispatcher::recall_distrust(WorkerSession& worker) const {
    if (pardoned_.contains(worker.drawer))
        return;
    if (const auto liar = liars_.find(worker.drawer); liar != liars_.end())
        worker.distrusted = liar->second;
    for (const auto& [id, job] : jobs_)
        for (const Distrusted& who : job.distrusted())
            if (who.worker == worker.drawer)
                worker.distrusted = who.reason;
}

} // namespace fraja::broker
