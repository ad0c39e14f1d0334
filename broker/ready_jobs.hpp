// ReadyJobs: the jobs that have something to give, in the order in which they deserve it. Nothing
// here looks at all of them: there may be a thousand, and a decision for every tile.
#pragma once

#include "broker/job.hpp"
#include "broker/party.hpp"
#include "common/base/ids.hpp"

#include <compare>
#include <cstdint>
#include <map>
#include <set>
#include <span>

namespace fraja::broker {

class ReadyJobs {
public:
    /// What orders the ready jobs of a party. Within a film: the lowest frame that nobody works on;
    /// where all have somebody, the one with the most work left for each of these. Of others: by
    /// their numbers.
    struct Place {
        bool is_worked_on = false;
        double ease = 0; ///< minus the work left for each worker; 0 where there is none
        std::uint32_t frame = 0, number = 0;
        JobId job;
        friend auto operator<=>(const Place&, const Place&) = default;
    };
    /// Ready jobs of one party that have the same priority. Valid until the next call of a function
    /// that is not const.
    struct Group {
        const Party* party = nullptr;
        std::int32_t priority = 0;
        std::set<Place> places; ///< never empty
        double work_left = 0;   ///< not handed out, of all of them
        std::size_t ranked_in_flight = 0;
        bool blocked = false;
    };

    /// Takes note of the job as it is now: of it and of its party. Its group is not blocked then.
    void update(const Job& job, bool is_ready);
    [[nodiscard]] std::size_t size() const { return entries_.size(); }
    [[nodiscard]] std::size_t group_count() const { return groups_.size(); }

    /// The group that deserves the next tile: of the highest priority, then with the fewest tiles
    /// in flight, so that parties share the farm. None: nothing is ready that is not blocked.
    [[nodiscard]] const Group* first() const;
    /// It suits nobody who has room: it is left out until something changes.
    void block(const Group& group);
    /// Of blocked groups those for which `suits(group)` says so are blocked no more.
    template <class Suits>
    void unblock_if(Suits suits) {
        for (auto key = blocked_.begin(); key != blocked_.end();) {
            Group& group = groups_.at(*key);
            if (!suits(group)) {
                ++key;
                continue;
            }
            key = blocked_.erase(key);
            group.blocked = false;
            enter(group);
        }
    }

    /// Calls `take(job)` for the group's jobs until it says true: first for those of `own`, where a
    /// worker is at home, in that order, then for the others in theirs. Whether it did.
    template <class Take>
    [[nodiscard]] bool any_for(const Group& group, std::span<const JobId> own, Take take) const {
        for (const JobId& job : own)
            if (const auto entry = entries_.find(job);
                entry != entries_.end() && entry->second.key == key_of(group) && take(job))
                return true;
        for (const Place& place : group.places)
            if (std::ranges::find(own, place.job) == own.end() && take(place.job))
                return true;
        return false;
    }
    /// Of the ready jobs of that job's group, itself included; 0 if it is not ready.
    [[nodiscard]] double group_work_left(const JobId& job) const;

private:
    struct Key {
        std::uint32_t party = 0; ///< its number
        std::int32_t priority = 0;
        friend auto operator<=>(const Key&, const Key&) = default;
    };
    struct Rank {
        std::int64_t minus_priority = 0;
        std::size_t in_flight = 0;
        std::uint32_t party = 0;
        friend auto operator<=>(const Rank&, const Rank&) = default;
    };
    struct Entry {
        Key key;
        Place place;
        double work_left = 0;
    };
    [[nodiscard]] static Key key_of(const Group& group) {
        return {group.party->number(), group.priority};
    }
    [[nodiscard]] static Rank rank_of(const Group& group) {
        return {-std::int64_t{group.priority}, group.ranked_in_flight, group.party->number()};
    }
    void enter(Group& group);
    [[nodiscard]] bool stays(const Job& job);
    void remove(const JobId& job);
    void rank_anew(const Party& party);

    std::map<JobId, Entry> entries_;
    std::map<Key, Group> groups_;
    std::set<Rank> order_; ///< of groups that are not blocked
    std::set<Key> blocked_;
};

} // namespace fraja::broker
