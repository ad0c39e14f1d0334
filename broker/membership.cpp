#include "broker/membership.hpp"

#include "broker/id_hash.hpp"

#include <algorithm>
#include <utility>

namespace fraja::broker {
namespace {

constexpr std::uint64_t counter_max = UINT64_MAX / 2; // no honest one comes to that
constexpr std::uint64_t terms_apart = 1u << 16;
constexpr std::uint32_t misjudged_max = 3;
constexpr int forgiven_after = 10; // times its patience

} // namespace

Membership::Membership(Rank own, const Terms& terms, bool alone, Instant now)
    : own_(own), terms_(terms), alone_(alone), looks_until_(alone ? now : now + terms.patience_max),
      is_synced_(alone) {}

bool Membership::meet(Instant now, const protocol::BrokerHello& hello) {
    const auto [at, is_new] = peers_.try_emplace(hello.broker);
    Peer& peer = at->second;
    const bool was_gone = is_new || !is_here(peer, now);
    const Rank rank{hello.started_at, hello.broker};
    if (is_new || peer.rank != rank)
        peer = Peer{rank, {}, {}, false, now};
    else
        note_heard(now, peer);
    peer.endpoint = hello.endpoint;
    peer.program_version = hello.program_version;
    peer.heard_at = now;
    return was_gone;
}

void Membership::hear(Instant now, const BrokerId& broker) {
    if (const auto found = peers_.find(broker); found != peers_.end())
        note_heard(now, found->second);
}

void Membership::note_heard(Instant now, Peer& peer) {
    if (!is_here(peer, now)) {
        peer.misjudged = std::min(peer.misjudged + 1, misjudged_max);
        peer.back_at = now;
    } else if (now - peer.back_at > forgiven_after * patience(peer)) {
        peer.misjudged = 0;
    }
    peer.heard_at = now;
}

void Membership::hear(Instant now, const protocol::BrokerBeat& beat) {
    learn(beat.term);
    const auto found = peers_.find(beat.broker);
    if (found == peers_.end())
        return;
    note_heard(now, found->second);
    Peer& peer = found->second;
    peer.is_synced = beat.is_synced;
    peer.digest = beat.digest;
    peer.leads = beat.leads;
    if (std::exchange(peer.has_workers, beat.has_workers) != beat.has_workers)
        peer.workers_changed_at = now;
    hear_of_leader(now, beat.term, beat.leader_silence);
}

void Membership::learn(const protocol::Term& term) {
    if (term.counter > counter_max || term <= term_)
        return;
    if (term.leader != term_.leader)
        leader_heard_at_.reset();
    term_ = term;
}

/// Whoever is heard here tells of its terms itself. Workers are believed of others alone, of whom
/// nobody else may tell, and seldom: or one could keep all from leading.
void Membership::learn_of_worker(Instant now, const protocol::Term& term,
                                 std::uint64_t counter_max) {
    const auto leader = peers_.find(term.leader);
    const bool is_heard = leader != peers_.end() && is_here(leader->second, now);
    if (term <= term_ || term.counter > counter_max || term.leader == own_.broker || is_heard ||
        now < rumours_from_)
        return;
    rumours_from_ = now + terms_.rumours_apart;
    learn(term);
}

void Membership::hear_of_leader(Instant now, const protocol::Term& term, Duration silence) {
    if (term.leader != term_.leader || silence < Duration{} || silence > terms_.told_patience)
        return;
    leader_heard_at_ = std::max(leader_heard_at_.value_or(Instant{}), now - silence);
}

void Membership::note_workers(Instant now, bool any) {
    if (std::exchange(any_workers_, any) != any)
        any_workers_at_ = now;
    if (any_workers_ != has_workers_ && now - any_workers_at_ >= terms_.workers_patience) {
        has_workers_ = any_workers_;
        workers_changed_at_ = now;
    }
}

void Membership::set_synced(Instant now) {
    is_synced_ = true;
    leads_from_ = std::max(leads_from_, now + terms_.settling);
}

bool Membership::is_here(const BrokerId& broker, Instant now) const {
    const auto found = peers_.find(broker);
    return found != peers_.end() && is_here(found->second, now);
}

std::vector<BrokerId> Membership::here(Instant now) const {
    std::vector<BrokerId> all;
    for (const auto& [id, peer] : peers_)
        if (is_here(peer, now))
            all.push_back(id);
    return all;
}

/// One of the two has workers, and that has been so for a while.
bool Membership::differs_in_workers(Instant now, const Peer& peer) const {
    return peer.has_workers != has_workers_ &&
           now - std::max(workers_changed_at_, peer.workers_changed_at) >= terms_.workers_settling;
}

/// No worker reaches it, and some reach this broker: if it led nothing would be drawn.
bool Membership::lacks_workers(Instant now, const Peer& peer) const {
    return has_workers_ && differs_in_workers(now, peer);
}

bool Membership::is_before(Instant now, const Peer& peer) const {
    return peer.is_synced && is_here(peer, now) &&
           (differs_in_workers(now, peer) ? peer.has_workers : peer.rank < own_);
}

const Membership::Peer* Membership::passed_over(Instant now) const {
    const Peer* first = nullptr;
    for (const auto& [id, peer] : peers_)
        if (peer.is_synced && is_here(peer, now) && peer.rank < own_ && lacks_workers(now, peer) &&
            (!first || peer.rank < first->rank))
            first = &peer;
    return first;
}

/// Others hear the leader that this broker does not: since it is cut off from that one alone, what
/// others have heard is newer than what it has heard itself.
bool Membership::leads_out_of_hearing(Instant now) const {
    if (term_.leader == own_.broker || !leader_heard_at_ ||
        now - *leader_heard_at_ > terms_.told_patience)
        return false;
    const auto leader = peers_.find(term_.leader);
    return leader == peers_.end() ||
           (!is_here(leader->second, now) &&
            *leader_heard_at_ > leader->second.heard_at + terms_.told_margin);
}

Duration Membership::leader_silence(Instant now) const {
    const auto leader = peers_.find(term_.leader);
    if (leader == peers_.end() || !leader->second.leads || lacks_workers(now, leader->second))
        return Duration::max();
    return now - leader->second.heard_at;
}

bool Membership::should_lead(Instant now) const {
    return is_synced_ && has_looked_around(now) && !leads_out_of_hearing(now) &&
           std::ranges::none_of(peers_,
                                [&](const auto& entry) { return is_before(now, entry.second); });
}

Membership::Change Membership::update(Instant now) {
    const bool fenced = leads_ && term_.leader != own_.broker;
    if (leads_ && (fenced || !should_lead(now))) {
        // Two that do not hear each other would go on outbidding each other as fast as their
        // workers tell them.
        if (fenced)
            leads_from_ = now + terms_.patience;
        leads_ = false;
        return Change::leads_no_more;
    }
    if (!leads_ && now >= leads_from_ && should_lead(now)) {
        term_ = next_term();
        leader_heard_at_.reset();
        leads_ = true;
        return Change::begins_to_lead;
    }
    return Change::none;
}

/// Two that begin one at once, as they do not hear each other, hardly begin the same: whoever knows
/// only the counter tells them apart.
protocol::Term Membership::next_term() const {
    if (alone_ && peers_.empty() && term_.counter < terms_.counter_min)
        return {terms_.counter_min, own_.broker};
    const std::uint64_t base = std::max(term_.counter, terms_.counter_min);
    return {(base / terms_apart + 1) * terms_apart + hash_of(own_.broker) % terms_apart,
            own_.broker};
}

Instant Membership::next_deadline(Instant now) const {
    Instant next = Instant::never();
    const auto consider = [&](Instant at) {
        if (at > now)
            next = std::min(next, at);
    };
    if (any_workers_ != has_workers_)
        consider(any_workers_at_ + terms_.workers_patience);
    consider(workers_changed_at_ + terms_.workers_settling);
    for (const auto& [id, peer] : peers_)
        consider(peer.workers_changed_at + terms_.workers_settling);
    if (leads_)
        return next;
    consider(looks_until_);
    consider(leads_from_);
    if (leader_heard_at_)
        consider(*leader_heard_at_ + terms_.told_patience + Duration(1));
    for (const auto& [id, peer] : peers_)
        consider(peer.heard_at + patience(peer) + Duration(1));
    return next;
}

void Membership::forgive(Duration absence) {
    for (auto& [id, peer] : peers_)
        peer.heard_at = peer.heard_at + absence;
    if (leader_heard_at_)
        leader_heard_at_ = *leader_heard_at_ + absence;
    any_workers_at_ = any_workers_at_ + absence;
}

} // namespace fraja::broker
