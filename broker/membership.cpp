#include "broker/membership.hpp"

#include "broker/id_hash.hpp"

#include <algorithm>

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
    found->second.is_synced = beat.is_synced;
    found->second.digest = beat.digest;
}

void Membership::learn(const protocol::Term& term) {
    if (term.counter <= counter_max)
        term_ = std::max(term_, term);
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

bool Membership::should_lead(Instant now) const {
    return is_synced_ && has_looked_around(now) &&
           std::ranges::none_of(peers_, [&](const auto& entry) {
               const Peer& peer = entry.second;
               return peer.is_synced && peer.rank < own_ && is_here(peer, now);
           });
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
    if (leads_)
        return next;
    consider(looks_until_);
    consider(leads_from_);
    for (const auto& [id, peer] : peers_)
        consider(peer.heard_at + patience(peer) + Duration(1));
    return next;
}

void Membership::forgive(Duration absence) {
    for (auto& [id, peer] : peers_)
        peer.heard_at = peer.heard_at + absence;
}

} // namespace fraja::broker
