#include "broker/ready_jobs.hpp"

#include <algorithm>
#include <limits>

namespace fraja::broker {

namespace {

double work_left(const Job& job) {
    return std::max(0.0, job.costs().left() - job.work_in_flight());
}

ReadyJobs::Place place_of(const Job& job) {
    // Whoever probes the picture will draw it.
    const std::size_t workers =
        job.party().is_film() ? job.workers().size() + (job.probe == Job::Probe::in_flight ? 1 : 0)
                              : 0;
    return {.is_worked_on = workers > 0,
            .ease = workers > 0 ? -work_left(job) / static_cast<double>(workers) : 0,
            .frame = job.submission().wishes.frame,
            .number = job.number(),
            .job = job.id()};
}

} // namespace

void ReadyJobs::enter(Group& group) {
    group.ranked_in_flight = group.party->in_flight_count();
    order_.insert(rank_of(group));
}

void ReadyJobs::update(const Job& job, bool is_ready) {
    if (is_ready && stays(job))
        return rank_anew(job.party());
    remove(job.id());
    if (is_ready) {
        const Key key{job.party().number(), job.priority};
        const auto [at, is_new] = groups_.try_emplace(key);
        Group& group = at->second;
        if (is_new) {
            group.party = &job.party();
            group.priority = job.priority;
            enter(group);
        }
        const Entry entry{key, place_of(job), work_left(job)};
        group.places.insert(entry.place);
        group.work_left += entry.work_left;
        entries_.emplace(job.id(), entry);
        if (group.blocked) {
            group.blocked = false;
            blocked_.erase(key);
            enter(group);
        }
    }
    rank_anew(job.party());
}

/// Whether it keeps its place, as it mostly does.
bool ReadyJobs::stays(const Job& job) {
    const auto at = entries_.find(job.id());
    if (at == entries_.end() || at->second.key != Key{job.party().number(), job.priority} ||
        at->second.place != place_of(job))
        return false;
    Group& group = groups_.at(at->second.key);
    if (group.blocked)
        return false;
    const double left = work_left(job);
    group.work_left += left - at->second.work_left;
    at->second.work_left = left;
    return true;
}

void ReadyJobs::remove(const JobId& job) {
    const auto at = entries_.find(job);
    if (at == entries_.end())
        return;
    const Entry entry = at->second;
    entries_.erase(at);
    const auto found = groups_.find(entry.key);
    Group& group = found->second;
    group.places.erase(entry.place);
    group.work_left -= entry.work_left;
    if (!group.places.empty())
        return;
    order_.erase(rank_of(group));
    blocked_.erase(entry.key);
    groups_.erase(found);
}

void ReadyJobs::rank_anew(const Party& party) {
    for (auto at = groups_.lower_bound({party.number(), std::numeric_limits<std::int32_t>::min()});
         at != groups_.end() && at->first.party == party.number(); ++at) {
        Group& group = at->second;
        if (group.blocked || group.ranked_in_flight == party.in_flight_count())
            continue;
        auto place = order_.extract(rank_of(group));
        group.ranked_in_flight = party.in_flight_count();
        place.value() = rank_of(group);
        order_.insert(std::move(place));
    }
}

const ReadyJobs::Group* ReadyJobs::first() const {
    if (order_.empty())
        return nullptr;
    const Rank& rank = *order_.begin();
    return &groups_.at({rank.party, static_cast<std::int32_t>(-rank.minus_priority)});
}

void ReadyJobs::block(const Group& group) {
    Group& mine = groups_.at(key_of(group));
    order_.erase(rank_of(mine));
    mine.blocked = true;
    blocked_.insert(key_of(mine));
}

double ReadyJobs::group_work_left(const JobId& job) const {
    const auto at = entries_.find(job);
    return at == entries_.end() ? 0 : groups_.at(at->second.key).work_left;
}

} // namespace fraja::broker
