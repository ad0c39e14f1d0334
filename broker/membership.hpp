// Membership: which brokers stand for each other, who of them is here, and who leads.
//
// Nothing that is promised hangs on who leads: two may, while they do not hear each other, and draw
// some tiles twice. Terms keep that short. With n brokers n - 1 may crash, so there is no majority
// to be asked: whoever is left leads.
#pragma once

#include "common/base/ids.hpp"
#include "common/base/instant.hpp"
#include "common/protocol/messages.hpp"

#include <compare>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace fraja::broker {

class Membership {
public:
    /// Who was there first leads, so that one that comes back changes nothing.
    struct Rank {
        Duration started_at{}; ///< since 1970, by its own clock
        BrokerId broker;
        friend auto operator<=>(const Rank&, const Rank&) = default;
    };
    struct Terms {
        Duration patience{};     ///< who was not heard for so long is gone
        Duration patience_max{}; ///< at the start, when nobody has been heard yet
        Duration settling{};     ///< for others to say what they have, once it has all
        /// That somebody hears the leader counts as long as that, and where it was heard later
        /// there than here by as much as that.
        Duration told_patience{}, told_margin{};
        /// Who has had no workers for so long has none; likewise who has had some has them.
        Duration workers_patience{};
        Duration workers_settling{};   ///< so long that must make a difference
        std::uint64_t counter_min = 0; ///< of a term that begins here: those before were lower
        Duration rumours_apart{};      ///< so seldom workers are believed of terms
    };
    struct Peer {
        Rank rank;
        std::string endpoint, program_version;
        bool is_synced = false; ///< as it says
        Instant heard_at{};
        bool leads = false;           ///< likewise
        bool has_workers = false;     ///< likewise
        Instant workers_changed_at{}; ///< that
        std::uint64_t digest = 0;
        std::uint32_t misjudged = 0; ///< so often it was held to be gone, and was not
        Instant back_at{};           ///< the last time
    };

    /// `alone`: no others are known, so it need not look for any before it leads.
    Membership(Rank own, const Terms& terms, bool alone, Instant now);

    /// A peer's hello. True: it is new, or was gone.
    bool meet(Instant now, const protocol::BrokerHello& hello);
    /// Any message of a peer that was met.
    void hear(Instant now, const BrokerId& broker);
    void hear(Instant now, const protocol::BrokerBeat& beat);
    /// A term that somebody has heard of.
    void learn(const protocol::Term& term);
    /// A worker says so, which may be wrong, or lie. Counters above `counter_max` are rubbish.
    void learn_of_worker(Instant now, const protocol::Term& term, std::uint64_t counter_max);
    /// Somebody else has heard of that term, and its leader say that it leads so long ago.
    void hear_of_leader(Instant now, const protocol::Term& term, Duration silence);
    /// Whether workers are here.
    void note_workers(Instant now, bool any);
    /// From now on it has all that the others have; it begins with nothing, unless alone. They may
    /// have come to that at the same time.
    void set_synced(Instant now);
    /// What becomes of time and of all that was heard. To be called after anything.
    enum class Change : std::uint8_t { none, begins_to_lead, leads_no_more };
    [[nodiscard]] Change update(Instant now);
    /// When an update is due even if nothing is heard.
    [[nodiscard]] Instant next_deadline(Instant now) const;
    /// A broker that stood still has heard nobody meanwhile.
    void forgive(Duration absence);

    [[nodiscard]] const Rank& own() const { return own_; }
    [[nodiscard]] bool leads() const { return leads_; }
    [[nodiscard]] bool is_synced() const { return is_synced_; }
    [[nodiscard]] const protocol::Term& term() const { return term_; }
    /// Also those that are gone.
    [[nodiscard]] const std::map<BrokerId, Peer>& peers() const { return peers_; }
    [[nodiscard]] bool knows(const BrokerId& broker) const { return peers_.contains(broker); }
    [[nodiscard]] bool is_here(const BrokerId& broker, Instant now) const;
    [[nodiscard]] std::vector<BrokerId> here(Instant now) const;
    /// It has waited for others long enough to know who is here.
    [[nodiscard]] bool has_looked_around(Instant now) const { return now >= looks_until_; }
    void forget(const BrokerId& broker) { peers_.erase(broker); }
    /// As in a beat.
    [[nodiscard]] bool has_workers() const { return has_workers_; }
    [[nodiscard]] Duration leader_silence(Instant now) const;
    /// Of those that are here the first that would lead before this one, if it had workers.
    [[nodiscard]] const Peer* passed_over(Instant now) const;

private:
    /// Whoever was misjudged is borne with for longer, or two would take turns on a slow network.
    [[nodiscard]] Duration patience(const Peer& peer) const {
        return terms_.patience * (1 << peer.misjudged);
    }
    [[nodiscard]] bool is_here(const Peer& peer, Instant now) const {
        return now - peer.heard_at <= patience(peer);
    }
    void note_heard(Instant now, Peer& peer);
    [[nodiscard]] bool differs_in_workers(Instant now, const Peer& peer) const;
    [[nodiscard]] bool is_before(Instant now, const Peer& peer) const;
    [[nodiscard]] bool lacks_workers(Instant now, const Peer& peer) const;
    [[nodiscard]] bool leads_out_of_hearing(Instant now) const;
    [[nodiscard]] bool should_lead(Instant now) const;
    [[nodiscard]] protocol::Term next_term() const;

    Rank own_;
    Terms terms_;
    bool alone_; ///< it began as a broker that was told of no others
    Instant looks_until_;
    bool is_synced_, leads_ = false;
    protocol::Term term_;    ///< the greatest
    Instant leads_from_{};   ///< not before, after somebody else has begun a term
    Instant rumours_from_{}; ///< not before workers are believed again
    std::map<BrokerId, Peer> peers_;
    std::optional<Instant> leader_heard_at_; ///< the term's, by anybody else
    bool has_workers_ = false;               ///< as its beats say
    Instant workers_changed_at_{};           ///< that
    bool any_workers_ = false;               ///< right now
    Instant any_workers_at_{};               ///< since
};

} // namespace fraja::broker
