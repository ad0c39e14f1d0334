// Dispatcher: who gets which tile.
#include "broker/dispatcher.hpp"

#include "common/base/assert.hpp"
#include "common/protocol/limits.hpp"
#include "common/protocol/probe.hpp"

#include <algorithm>

namespace fraja::broker {

using namespace protocol;

namespace {

// A tile is that part of what is left for a thread: so tiles are large first and small in the end.
// Where nothing is known of what the picture's parts cost, or only what a probe tells, one that is
// much more than was thought must not be too much.
constexpr double parts_of_share = 3, parts_of_share_probed = 4, parts_of_share_blank = 64;
constexpr double parts_of_order = 2;
constexpr std::size_t compared_idle_workers_max = 256; // in search of the fastest
constexpr double learnt_share = 0.05; // of the picture, from which on more is known than a probe's

// Camera rays of a probe: no more than that part of the picture's.
constexpr double probe_share = 1.0 / 512;
constexpr std::uint64_t probe_squares_min = 4; // fewer tell nothing

/// `wanted` K or K=V, `tag` likewise.
bool fits(const std::string& wanted, const std::string& tag) {
    return tag == wanted ||
           (tag.size() > wanted.size() && tag.starts_with(wanted) && tag[wanted.size()] == '=');
}

} // namespace

void Dispatcher::update_load(const PeerId& peer, WorkerSession& worker) {
    std::optional<std::uint64_t> load;
    if (worker.held() < worker.room())
        load = (std::uint64_t{worker.held()} << 16) / worker.hello.threads;
    if (load == worker.load)
        return;
    if (worker.load)
        free_workers_.erase({*worker.load, peer});
    if (load)
        free_workers_.insert({*load, peer});
    worker.load = load;
    if (load)
        changed_workers_.push_back(peer);
}

double Dispatcher::speed_of(const WorkerSession& worker) const {
    return worker.speed.rays_per_s(speed_.is_known() ? speed_.rays_per_s() : 1);
}

/// Takes note of whether the job has something to give, and of how much.
void Dispatcher::look_ready(const Job& job) {
    ready_.update(job, job.may_run() && (job.has_pending() || job.probe == Job::Probe::wanted ||
                                         job.checks().has_pending()));
}

void Dispatcher::dispatch() {
    if (store_is_behind())
        return;
    release_held_back();
    offer_to_changed_workers();
    give_out();
    help_out();
    changed_workers_.clear();
}

/// What suited nobody may suit those who have changed.
void Dispatcher::offer_to_changed_workers() {
    for (const PeerId& peer : changed_workers_) {
        const auto worker = workers_.find(peer);
        if (worker != workers_.end() && worker->second.load)
            ready_.unblock_if([&](const ReadyJobs::Group& group) {
                if (!suits(worker->second, peer, *group.party))
                    return false;
                const Job& first = jobs_.at(group.places.begin()->job);
                return !is_held_back(first) || newcomers_help(first) ||
                       has_scene(worker->second, first.submission().scene);
            });
    }
}

void Dispatcher::give_out() {
    while (!free_workers_.empty()) {
        const ReadyJobs::Group* group = ready_.first();
        if (!group)
            return;
        if (!give_one_of(*group))
            ready_.block(*group);
    }
}

/// A tile of the group to the least loaded worker that may have one; of a party that takes on
/// another one of the few it wants, to the fastest that is idle: with that it stays. Where more
/// workers would not help, to one that has the scene; that one is the first to be asked, too, where
/// nobody is at it yet, or some are late.
bool Dispatcher::give_one_of(const ReadyJobs::Group& group) {
    const Party& party = *group.party;
    Job& first = jobs_.at(group.places.begin()->job);
    if (!party.is_film() && is_waiting_to_be_dealt_out(first))
        return false;
    const auto give = [&](const PeerId& peer) {
        WorkerSession& worker = workers_.at(peer);
        return suits(worker, peer, party) &&
               ready_.any_for(group, frames_at_hand(worker, party),
                              [&](const JobId& job) { return grant(peer, worker, jobs_.at(job)); });
    };
    // any_of stops at the grant, which changes free_workers_ and the group.
    const auto give_to = [&](const auto& whom) {
        return std::ranges::any_of(free_workers_, [&](const auto& free) {
            return whom(workers_.at(free.second)) && give(PeerId(free.second));
        });
    };
    const auto is_at_home = [&](const WorkerSession& worker) {
        return has_scene(worker, first.submission().scene);
    };
    if (!newcomers_help(first)) {
        if (give_to(is_at_home))
            return true;
        hold_back(first);
        return false;
    }
    if (party.wishes().workers_max > party.workers().size() &&
        party.wishes().schedule == Schedule::demand)
        if (const auto fastest = fastest_idle_worker(party); fastest && give(*fastest))
            return true;
    if ((party.workers().empty() || first.was_overbooked()) &&
        give_to([&](const WorkerSession& worker) {
            return worker.held() < worker.hello.threads && is_at_home(worker);
        }))
        return true;
    return give_to([](const WorkerSession&) { return true; });
}

std::optional<PeerId> Dispatcher::fastest_idle_worker(const Party& party) const {
    std::optional<PeerId> fastest;
    double best = 0;
    std::size_t compared = 0;
    for (const auto& [load, peer] : free_workers_) {
        if (load > 0 || compared++ == compared_idle_workers_max)
            break; // those behind it are no less loaded
        const WorkerSession& worker = workers_.at(peer);
        const double rays_per_s = speed_of(worker) * worker.hello.threads;
        if (rays_per_s > best && suits(worker, peer, party)) {
            best = rays_per_s;
            fastest = peer;
        }
    }
    return fastest;
}

/// The frames of the film that the worker is at, the one that it was given last before the others:
/// it has these scenes, and a frame that is one worker's whole is no trouble to others.
std::vector<JobId> Dispatcher::frames_at_hand(const WorkerSession& worker, const Party& party) {
    std::vector<JobId> frames;
    if (!party.is_film())
        return frames;
    const auto last = worker.frames.find(party.wishes().film);
    if (last == worker.frames.end())
        return frames; // it has had none
    frames.push_back(last->second);
    for (auto at = worker.grants.begin(); at != worker.grants.end();) {
        const JobId& job = at->first.job;
        if (job != frames.front())
            frames.push_back(job); // perhaps of something else: that is not in the group
        at = worker.grants.upper_bound({job, TileIndex{UINT32_MAX}, AttemptNumber{UINT32_MAX}});
    }
    return frames;
}

bool Dispatcher::suits(const WorkerSession& worker, const PeerId& peer, const Party& party) const {
    const Wishes& wishes = party.wishes();
    if (wishes.workers_max > 0 && party.workers().size() >= wishes.workers_max &&
        !party.workers().contains(peer))
        return false;
    return has_tags(worker, wishes);
}

bool Dispatcher::has_tags(const WorkerSession& worker, const Wishes& wishes) {
    return std::ranges::all_of(wishes.tags, [&](const std::string& wanted) {
        return std::ranges::any_of(worker.hello.tags,
                                   [&](const std::string& tag) { return fits(wanted, tag); });
    });
}

/// Than those on whom a tile of it failed.
bool Dispatcher::has_others(const Job& job, std::span<const WorkerId> failed_on) const {
    return std::ranges::any_of(workers_, [&](const auto& entry) {
        const WorkerSession& worker = entry.second;
        return worker.room() > 0 && has_tags(worker, job.submission().wishes) &&
               !job.distrusts(worker.drawer) &&
               std::ranges::find(failed_on, worker.hello.worker) == failed_on.end();
    });
}

/// Deals it out, if it can be. By work: when a probe has told of that.
bool Dispatcher::is_waiting_to_be_dealt_out(Job& job) {
    const Schedule schedule = job.submission().wishes.schedule;
    if (schedule == Schedule::demand || job.is_dealt_out() || job.in_flight_count() > 0)
        return false;
    if (schedule == Schedule::weighted && job.probe == Job::Probe::in_flight)
        return true;
    if (schedule == Schedule::weighted && job.probe == Job::Probe::wanted)
        return false; // to be granted first
    std::vector<Job::Share> shares;
    const std::size_t workers_max = job.submission().wishes.workers_max;
    for (const auto& [peer, worker] : workers_)
        if (worker.room() > 0 && suits(worker, peer, job.party()) &&
            !job.distrusts(worker.drawer) && (workers_max == 0 || shares.size() < workers_max))
            shares.push_back({worker.hello.worker, schedule == Schedule::weighted
                                                       ? speed_of(worker) * worker.hello.threads
                                                       : 1});
    if (shares.empty())
        return true;
    job.deal_out(shares, schedule == Schedule::weighted, schedule == Schedule::stealing);
    return false;
}

bool Dispatcher::grant(const PeerId& peer, WorkerSession& worker, Job& job) {
    return !job.distrusts(worker.drawer) &&
           (grant_probe(peer, worker, job) || grant_check(peer, worker, job) ||
            grant_tile(peer, worker, job));
}

/// The side of a probe's squares: so large that it is no burden, or as was ordered. Nothing where
/// there would be too few to tell anything.
std::optional<std::uint32_t> Dispatcher::probe_side(const Job& job) const {
    if (const auto order = orders_.find(job.id()); order != orders_.end())
        return order->second.probe_side;
    const PictureSettings& s = job.submission().settings;
    const auto pixels = static_cast<double>(s.crop.pixel_count());
    const auto squares_max =
        std::min(limits_.probe_squares_max,
                 static_cast<std::uint64_t>(pixels * camera_rays_min(s) * probe_share));
    if (squares_max < probe_squares_min)
        return std::nullopt;
    std::uint32_t side = job.grid().side();
    while (probe_squares(s.crop, side) > squares_max && side < picture_side_max)
        side *= 2;
    if (side > s.crop.width + s.crop.height)
        return std::nullopt;
    return side;
}

bool Dispatcher::grant_probe(const PeerId& peer, WorkerSession& worker, Job& job) {
    if (job.probe != Job::Probe::wanted)
        return false;
    const auto side = probe_side(job);
    if (!side) {
        job.probe = Job::Probe::over;
        return false;
    }
    job.probe = Job::Probe::in_flight;
    job.prober = peer;
    const auto squares = static_cast<double>(probe_squares(job.submission().settings.crop, *side));
    send_grant(peer, worker, job, Grant{.probe_side = *side, .tile = {}, .work = squares},
               AttemptNumber{attempts_ + 1});
    return true;
}

/// So that all threads are through at about the same time, and no time is lost with too many tiles.
/// Threads that are through with a frame go on with the film's next one: so as long as there are
/// some, a tile is a part of what is left of the film, and a frame is cut for its worker's threads.
/// An order is thought to be drawn by the `branch_threads`-th part of all: it is cut for these.
double Dispatcher::work_wanted(const WorkerSession& worker, const Job& job) const {
    const double speed = speed_of(worker);
    const double left = std::max(0.0, job.costs().left() - job.work_in_flight());
    const double part = speed / std::max(capacity_, speed); // of what the farm can do
    const double parts = job.costs().is_blank()                    ? parts_of_share_blank
                         : job.costs().share_done() < learnt_share ? parts_of_share_probed
                                                                   : parts_of_share;
    double wanted = left * part / parts;
    if (is_order(job))
        wanted = (job.costs().done() + job.costs().left()) * part * branch_threads / parts_of_order;
    else if (job.party().is_film())
        wanted = std::max(wanted, std::min(ready_.group_work_left(job.id()) * part / parts,
                                           left / worker.hello.threads));
    if (!speed_.is_known())
        return wanted;
    return std::clamp(wanted, tile_time_min_s() * speed, seconds(limits_.tile_time_max) * speed);
}

/// Where speeds are unknown, none: nobody knows how long that would take.
double Dispatcher::joined_work_max(const WorkerSession& worker) const {
    return speed_.is_known() ? seconds(limits_.joined_time_max) * speed_of(worker) : 0;
}

/// What is ordered is cut for its branch.
std::optional<double> Dispatcher::scout_work(const WorkerSession& worker, const Job& job) const {
    if (!speed_.is_known() || is_order(job))
        return std::nullopt;
    return tile_time_min_s() * speed_of(worker);
}

double Dispatcher::tile_time_min_s() const {
    const double threads = capacity_ / std::max(speed_.rays_per_s(), 1e-9);
    // Workers may say anything of their threads.
    return std::min(std::max(seconds(limits_.tile_time_min), threads / limits_.tiles_per_s_max),
                    seconds(limits_.tile_time_max));
}

bool Dispatcher::grant_tile(const PeerId& peer, WorkerSession& worker, Job& job) {
    const AttemptNumber attempt{attempts_ + 1};
    const auto handed = job.assign_next(
        {.worker = worker.hello.worker,
         .peer = peer,
         .work_wanted = work_wanted(worker, job),
         .joined_work_max = joined_work_max(worker),
         .scout_work = scout_work(worker, job),
         .has_others =
             [&](std::span<const WorkerId> failed_on) { return has_others(job, failed_on); },
         .attempt = attempt});
    if (!handed)
        return false;
    send_grant(peer, worker, job,
               Grant{.id = handed->id, .tile = handed->tile, .work = handed->work}, attempt);
    if (job.phase == JobPhase::queued) {
        job.phase = JobPhase::running;
        publish_state(job);
    }
    return true;
}

void Dispatcher::send_grant(const PeerId& peer, WorkerSession& worker, Job& job, Grant grant,
                            AttemptNumber attempt) {
    const std::uint32_t probe_side = grant.probe_side;
    FRAJA_ASSERT(worker.held() < worker.room());
    attempts_ = static_cast<std::uint32_t>(attempt);
    ++counters_.tiles_sent;
    const TileIndex tile = probe_side > 0 ? TileIndex{} : job.index(grant.tile);
    const auto started = static_cast<std::size_t>(std::ranges::count_if(
        worker.grants, [](const auto& other) { return other.second.started_at.has_value(); }));
    grant.granted_at = grant.progress_at = now_;
    if (started < worker.hello.threads)
        grant.started_at = now_;
    grant.number = worker.tiles_sent++;
    grant.fetches_scene = note_scene(worker, job.submission().scene);
    const SubmitJob& s = job.submission();
    RenderTile order{.job = job.id(),
                     .tile = tile,
                     .attempt = attempt,
                     .frame = s.wishes.frame,
                     .pass = job.pass(grant.tile),
                     .rect = probe_side > 0 ? s.settings.crop : job.rect(grant.tile),
                     .scene = s.scene,
                     .scene_bytes = s.scene_bytes,
                     .settings = s.settings,
                     .probe_side = probe_side,
                     .term = term()};
    if (const auto ordered = orders_.find(job.id()); ordered != orders_.end())
        order.settings.crop = ordered->second.crop;
    send(peer, std::move(order));
    worker.grants.emplace(GrantKey{job.id(), tile, attempt}, std::move(grant));
    count_grant_of_order(job.id(), true);
    if (job.party().is_film())
        worker.frames[s.wishes.film] = job.id();
    update_load(peer, worker);
    look_ready(job);
}

} // namespace fraja::broker
