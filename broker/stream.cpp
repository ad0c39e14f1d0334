// Dispatcher: who hears of it.
#include "broker/dispatcher.hpp"

#include "common/base/text.hpp"
#include "common/base/version.hpp"
#include "common/protocol/topics.hpp"

#include <algorithm>

namespace fraja::broker {

using namespace protocol;

void Dispatcher::on(const TopicSubscribed& event) {
    if (const auto nonce = topic_id<Nonce>('N', event.topic)) {
        actions_->push_back(Publish{event.topic, Barrier{*nonce, term().counter}});
    } else if (const auto job = topic_id<JobId>('J', event.topic)) {
        subscribed_jobs_.insert(*job);
    } else if (event.topic == farm_topic) {
        farm_subscribed_ = true;
        next_farm_state_ = now_;
    }
}

void Dispatcher::on(const TopicUnsubscribed& event) {
    if (const auto job = topic_id<JobId>('J', event.topic))
        subscribed_jobs_.erase(*job);
    else if (event.topic == farm_topic)
        farm_subscribed_ = false;
}

bool Dispatcher::wants_digest(const Job& job) const {
    return job.phase != JobPhase::waiting_for_scene &&
           (!job.over_at || now_ - *job.over_at < limits_.digest_tail);
}

void Dispatcher::publish_state(const Job& job) {
    if (subscribed_jobs_.contains(job.id()))
        actions_->push_back(Publish{job_topic(job.id()), state_of(job)});
}

void Dispatcher::publish_digests() {
    for (const JobId& id : subscribed_jobs_)
        if (const Job* job = job_of(id); job && wants_digest(*job))
            publish_state(*job);
}

JobState Dispatcher::brief_state(const Job& job) const {
    JobState state = state_of(job);
    state.reason = std::string(clipped(state.reason, limits_.farm_reason_bytes_max));
    if (state.distrusted.size() > limits_.farm_distrusted_max)
        state.distrusted.resize(limits_.farm_distrusted_max);
    for (Distrusted& who : state.distrusted)
        who.reason.clear();
    return state;
}

WorkerState Dispatcher::worker_state(const WorkerSession& worker) const {
    const bool quarantined = worker.quarantined_until && *worker.quarantined_until > now_;
    return {.worker = worker.hello.worker,
            .worker_name = worker.hello.worker_name,
            .program_version = worker.hello.program_version,
            .threads = worker.hello.threads,
            .credit = worker.credit,
            .in_flight_count = static_cast<std::uint32_t>(worker.held()),
            .tiles_done = worker.tiles_done,
            .rays = worker.rays,
            .draining = worker.drained || worker.credit == 0,
            .quarantined = quarantined ? *worker.quarantined_until - now_ : Duration{},
            .tags = worker.hello.tags,
            .distrusted = worker.distrusted};
}

WorkerState Dispatcher::brief_state(const WorkerSession& worker) const {
    WorkerState state = worker_state(worker);
    state.program_version =
        std::string(clipped(state.program_version, limits_.farm_version_bytes_max));
    state.distrusted = std::string(clipped(state.distrusted, limits_.farm_distrust_bytes_max));
    std::size_t bytes = 0;
    const auto beyond = std::ranges::find_if(state.tags, [&](const std::string& tag) {
        return (bytes += tag.size()) > limits_.farm_tags_bytes_max;
    });
    state.tags.erase(beyond, state.tags.end());
    return state;
}

protocol::BrokerState Dispatcher::broker_state() const {
    const Figures f = figures();
    const Counters& c = f.counters;
    return {.broker = identity_.broker,
            .program_version = std::string(fraja::version),
            .uptime = now_ - identity_.started_at,
            .unix_time = identity_.unix_offset + (now_ - Instant{}),
            .keeps = identity_.keeps,
            .trouble = f.store_trouble,
            .jobs = jobs_.size(),
            .jobs_ready = f.jobs_ready,
            .workers = f.workers(),
            .threads = f.threads,
            .clients = f.clients,
            .tiles_in_flight = f.tiles_in_flight,
            .jobs_done = c.jobs_done,
            .jobs_failed = c.jobs_failed,
            .jobs_cancelled = c.jobs_cancelled,
            .tiles_done = c.tiles_done,
            .tiles_failed = c.tiles_failed,
            .tiles_requeued = c.tiles_requeued,
            .tiles_overbooked = c.tiles_overbooked,
            .workers_lost = c.workers_lost,
            .rays = c.rays,
            .render_time = c.render_time,
            .tiles_checked = c.tiles_checked,
            .workers_distrusted = c.workers_distrusted};
}

void Dispatcher::publish_farm_state() {
    if (!farm_subscribed_)
        return;
    FarmState farm{.epoch = term().counter, .jobs = {}, .workers = {}, .broker = broker_state()};
    for (auto entry = job_by_number_.rbegin();
         entry != job_by_number_.rend() && farm.jobs.size() < limits_.farm_jobs_max; ++entry)
        farm.jobs.push_back(brief_state(jobs_.at(entry->second)));
    for (const auto& [peer, worker] : workers_) {
        if (farm.workers.size() >= limits_.farm_workers_max)
            break;
        farm.workers.push_back(brief_state(worker));
    }
    farm.brokers = peer_states();
    actions_->push_back(Publish{std::string(farm_topic), std::move(farm)});
}

/// What an earlier broker had not checked is dropped when a later term is heeded. Whoever has tiles
/// of a later leader, which may not have been checked yet, is not told that these make the picture
/// whole: the end of a checked job belongs to its epoch until that leader has come to it as well.
std::uint64_t Dispatcher::epoch_of(const Job& job) const {
    const bool is_of_before =
        job.is_checked() && job.phase == JobPhase::done && !membership_.leads();
    return is_of_before ? job.done_in : term().counter;
}

std::uint64_t Dispatcher::epoch_of_tiles(const Job& job) const {
    return std::min(epoch_of(job), heeded_term_.counter);
}

TileDone Dispatcher::as_sent_now(const Job& job, TileDone tile) const {
    tile.epoch = epoch_of_tiles(job);
    return tile;
}

void Dispatcher::repair(const PeerId& peer, const Repair& wish, Instant until) {
    const Job* job = job_of(wish.job);
    if (!job || is_order(*job))
        return refuse(peer, RefusalCode::no_such_job, "there is no such job", wish.job);
    if (!may_follow(peer, *job))
        return refuse(peer, RefusalCode::no_such_job, std::string(cannot_follow), wish.job);
    std::uint32_t tiles = 0;
    std::uint64_t bytes = 0;
    const std::uint32_t tiles_max = std::min(wish.tiles_max, limits_.repair_tiles_max);
    std::vector<TileIndex> stored;
    const std::uint32_t left = job->missing(Bitmap(wish.have), [&](const Job::Result& result) {
        if (result.came_at > until)
            return true;
        const std::uint64_t size =
            job->rect(result.tile).pixel_count() * job->submission().settings.pixel_bytes();
        if (tiles >= tiles_max || (tiles > 0 && bytes + size > limits_.repair_bytes_max))
            return false;
        ++tiles;
        bytes += size;
        if (result.pixels)
            send(peer, as_sent_now(*job, *result.pixels));
        else
            stored.push_back(job->index(result.tile));
        return true;
    });
    if (!stored.empty())
        actions_->push_back(
            SendStored{peer, job->id(), std::move(stored), epoch_of_tiles(*job), version_of(peer)});
    send(peer, RepairDone{state_of(*job), left});
}

} // namespace fraja::broker
