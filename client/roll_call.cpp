#include "client/roll_call.hpp"

#include "client/reaching.hpp"
#include "client/watching.hpp"
#include "common/base/text.hpp"
#include "common/discovery/source.hpp"
#include "common/net/clock.hpp"
#include "common/protocol/limits.hpp"

#include <algorithm>
#include <ranges>
#include <utility>

namespace fraja::client {

namespace {

using namespace std::chrono_literals;

constexpr Duration hindrance_pause = 20ms; // whether it is known what hinders

/// What another broker says of the one at that endpoint; null: nothing.
const protocol::PeerState* told_of(const std::string& endpoint, const protocol::FarmState& farm) {
    const auto found = std::ranges::find(farm.brokers, endpoint, &protocol::PeerState::endpoint);
    return found == farm.brokers.end() ? nullptr : &*found;
}

/// Null: none that is known by its id has answered.
AskedBroker* find(std::vector<AskedBroker>& answered, const BrokerId& broker) {
    const auto found = std::ranges::find_if(answered, [&](const AskedBroker& asked) {
        return asked.farm && broker != BrokerId{} && asked.farm->broker.broker == broker;
    });
    return found == answered.end() ? nullptr : &*found;
}

} // namespace

/// One that is asked.
class RollCall::Guest final : public Listener {
public:
    Guest(const net::Context& context, std::string where, SessionOptions session)
        : endpoint(std::move(where)), asked_at(net::now()), reaching_({endpoint}),
          core_(at(endpoint, std::move(session))),
          conversation_(context, core_, *this, Conversation::Advice::none) {}

    void hear(Instant now, const News& news) override {
        if (const auto* changed = std::get_if<FarmChanged>(&news); changed && !is_lost_) {
            if (!farm)
                farm = changed->farm;
        } else if (const auto* connection = std::get_if<ConnectionChanged>(&news)) {
            is_lost_ = is_lost_ || !connection->connected; // another one may answer then
            if (connection->connected)
                answered_at = std::min(answered_at, now);
        }
    }
    std::optional<Outcome> wants_to_leave() override {
        return farm || is_lost_ ? std::optional(Outcome{}) : std::nullopt;
    }

    /// False: there is more to read.
    bool turn() {
        const bool drained = conversation_.turn();
        if (const auto& last = conversation_.outcome())
            settle(*last);
        return drained;
    }
    void settle(Outcome last) {
        outcome = std::move(last);
        conversation_.take_leave();
    }
    [[nodiscard]] const Conversation& conversation() const { return conversation_; }
    /// Nothing: that is not known yet. Empty: nothing does.
    [[nodiscard]] std::optional<std::string> hindrance() const {
        const auto known = reaching_.hindrances();
        return known ? std::optional(known->front()) : std::nullopt;
    }

    const std::string endpoint;
    const Instant asked_at;
    Instant answered_at = Instant::never();
    std::optional<protocol::FarmState> farm;
    std::optional<Outcome> outcome; ///< nothing: it is waited for

private:
    static SessionOptions at(const std::string& endpoint, SessionOptions session) {
        session.brokers = {endpoint};
        return session;
    }

    bool is_lost_ = false;
    Reaching reaching_;
    FarmWatching core_;
    Conversation conversation_; // last: it uses the others
};

RollCall::RollCall(const net::Context& context, const std::vector<std::string>& named,
                   SessionOptions session, SearchNotice notice)
    : context_(context), session_(std::move(session)), notice_(std::move(notice)) {
    for (const std::string& endpoint : named)
        ask(endpoint);
}
RollCall::~RollCall() = default;

Outcome RollCall::hold(const net::SignalWatch* signals) {
    const auto is_waited_for = [](const Guest& guest) { return !guest.outcome; };
    while (std::ranges::any_of(guests_, is_waited_for)) {
        const bool drained = turn();
        if (const auto signal = signals ? signals->receive() : std::nullopt)
            return outcome_of(*signal);
        if (drained && std::ranges::any_of(guests_, is_waited_for))
            wait(signals);
    }
    notice_.end();
    return outcome();
}

/// False: there is more to read.
bool RollCall::turn() {
    bool drained = true;
    for (Guest& guest : guests_)
        if (!guest.outcome) {
            drained = guest.turn() && drained;
            answered_at_ = std::min(answered_at_, guest.answered_at);
        }
    if (answered_at_ != Instant::never())
        notice_.end();
    ask_those_told_of();
    for (Guest& guest : guests_)
        settle(guest);
    notice_due_ = notice_.tick(net::now());
    return drained;
}

void RollCall::ask(const std::string& endpoint) {
    const auto is_asked = [&](const Guest& guest) { return guest.endpoint == endpoint; };
    if (std::ranges::none_of(guests_, is_asked))
        guests_.emplace_back(context_, endpoint, session_);
}

void RollCall::ask_those_told_of() {
    std::vector<std::string> told;
    for (const Guest& guest : guests_)
        if (guest.farm)
            for (const protocol::PeerState& peer : guest.farm->brokers)
                if (!peer.endpoint.empty() && !discovery::is_source(peer.endpoint))
                    told.push_back(peer.endpoint);
    for (const std::string& endpoint : told)
        if (guests_.size() < protocol::brokers_max)
            ask(endpoint);
}

/// Where one has answered, nobody waits for one that cannot be reached.
void RollCall::settle(Guest& guest) {
    if (guest.outcome || answered_at_ == Instant::never())
        return;
    const bool is_hindered =
        guest.answered_at == Instant::never() && !guest.hindrance().value_or(std::string()).empty();
    if (is_hindered || net::now() >= std::max(answered_at_, guest.asked_at) + roll_call_patience)
        guest.settle({ExitCode::unreachable, {}});
}

void RollCall::wait(const net::SignalWatch* signals) const {
    std::vector<net::Waitable> all;
    if (signals)
        all.emplace_back(signals->fd());
    Instant due = notice_due_;
    for (const Guest& guest : guests_) {
        if (guest.outcome)
            continue;
        guest.conversation().wait_also(all);
        due = std::min(due, guest.conversation().due());
        if (answered_at_ == Instant::never())
            continue;
        due = std::min(due, std::max(answered_at_, guest.asked_at) + roll_call_patience);
        if (!guest.hindrance())
            due = std::min(due, net::now() + hindrance_pause);
    }
    net::wait(all, due - net::now());
}

Outcome RollCall::outcome() const {
    std::vector<std::string> endpoints;
    const Guest* refused = nullptr;
    for (const Guest& guest : guests_) {
        if (guest.farm)
            return {};
        endpoints.push_back(guest.endpoint);
        if (guest.outcome && guest.outcome->code == ExitCode::refused)
            refused = &guest;
    }
    if (refused)
        return *refused->outcome;
    if (guests_.size() == 1 && discovery::is_source(endpoints.front()))
        return *guests_.front().outcome;
    return {ExitCode::unreachable, "no broker answers at " + comma_list(endpoints) +
                                       " (fraja-broker starts one, -b HOST:PORT names another)"};
}

std::vector<AskedBroker> RollCall::brokers() const {
    std::vector<AskedBroker> all;
    for (const Guest& guest : guests_)
        all.push_back({guest.endpoint, guest.farm, trouble_of(guest)});
    return each_once(std::move(all));
}

std::string RollCall::trouble_of(const Guest& guest) const {
    if (guest.farm)
        return {};
    const std::string reason = guest.outcome ? guest.outcome->reason : std::string();
    if (guest.outcome && guest.outcome->code == ExitCode::refused)
        return reason.substr(reason.starts_with(guest.endpoint + ": ") ? guest.endpoint.size() + 2
                                                                       : 0);
    if (guest.answered_at != Instant::never())
        return "answers, but its stream does not";
    if (discovery::is_source(guest.endpoint))
        return reason;
    const auto hindrance = guest.hindrance();
    if (!hindrance || hindrance->empty())
        return "does not answer";
    const bool is_heard = std::ranges::any_of(guests_, [&](const Guest& other) {
        const auto* const peer = other.farm ? told_of(guest.endpoint, *other.farm) : nullptr;
        return peer && peer->is_here;
    });
    return (is_heard ? "not reached from here: " : "gone: ") + *hindrance;
}

std::vector<AskedBroker> each_once(std::vector<AskedBroker> asked) {
    std::vector<AskedBroker> once;
    for (AskedBroker& broker : asked) {
        AskedBroker* const same = broker.farm ? find(once, broker.farm->broker.broker) : nullptr;
        if (same)
            same->also_at.push_back(std::move(broker.endpoint));
        else
            once.push_back(std::move(broker));
    }
    std::vector<AskedBroker> shown;
    for (const AskedBroker& broker : once) {
        const bool is_elsewhere =
            !broker.farm && std::ranges::any_of(once, [&](const AskedBroker& other) {
                const auto* const peer =
                    other.farm ? told_of(broker.endpoint, *other.farm) : nullptr;
                return peer && find(once, peer->broker);
            });
        if (!is_elsewhere)
            shown.push_back(broker);
    }
    return shown;
}

} // namespace fraja::client
