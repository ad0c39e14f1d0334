#include "client/session.hpp"

#include "common/base/text.hpp"
#include "common/base/version.hpp"
#include "common/discovery/source.hpp"
#include "common/protocol/limits.hpp"

#include <algorithm>
#include <utility>

namespace fraja::client {
namespace {

using namespace std::chrono_literals;

constexpr Duration hello_repeat = 1s;        // unanswered
constexpr Duration hello_pause_first = 10ms; // not even sent: the connection is being made
constexpr Duration hello_pause_max = 500ms;
constexpr Duration turn_max = 2s;             // for one of several brokers
constexpr Duration source_turn_max = 5s;      // for a source beside others
constexpr Duration look_pause = 1s;           // between two looks at one source
constexpr std::size_t brokers_found_max = 64; // of one source
constexpr int losses_max = 3;                 // as often the silence that is borne is doubled
constexpr int forgiven_after = 10;            // times as long as that: losses are forgotten

} // namespace

Session::Session(SessionOptions options)
    : options_(std::move(options)), brokers_(options_.brokers) {
    FRAJA_ASSERT(!options_.brokers.empty());
}

void Session::start(Instant now, std::vector<Action>& actions) {
    looking_since_ = now;
    look_for_broker(now, actions);
}

Session::Change Session::step(Instant now, const Event& event, std::vector<Action>& actions) {
    if (ended_)
        return Change::none;
    if (std::holds_alternative<NotSent>(event)) {
        if (is_at_source()) {
            // Nobody is spoken to.
        } else if (!open_) {
            hello_due_ = now + hello_pause_;
            hello_pause_ = std::min(2 * hello_pause_, hello_pause_max);
        } else if (brokers_.size() > 1) {
            lose(now, actions); // the connection is gone, and there are others
        }
        return Change::none;
    }
    if (const auto* away = std::get_if<TurnedAway>(&event))
        return open_ ? Change::none : take_refusal(now, away->reason, actions);
    if (const auto* bad = std::get_if<Undecodable>(&event)) {
        if (bad->error.code == ErrorCode::version_mismatch && !open_ && has_sources())
            return take_refusal(now, bad->error.message, actions);
        if (bad->error.code == ErrorCode::version_mismatch)
            return end(Change::refused, {ExitCode::refused, broker() + ": " + bad->error.message});
        return Change::none;
    }
    if (const auto* from = std::get_if<FromBroker>(&event)) {
        silent_at_ = open_ ? silent_by(now) : Instant::never();
        if (const auto* welcome = std::get_if<protocol::Welcome>(&from->message)) {
            speak(from->version, actions); // if a hello has gone out since
            return take(now, *welcome, actions);
        }
        if (const auto* refused = std::get_if<protocol::Refused>(&from->message))
            return refused->code == protocol::RefusalCode::version_mismatch &&
                           from->version < protocol::version
                       ? heed_older_version(now, from->version, actions)
                       : take(now, *refused, actions);
        if (const auto* told = std::get_if<protocol::Brokers>(&from->message); told && open_)
            learn(told->brokers);
        return Change::none;
    }
    if (const auto* found = std::get_if<BrokersFound>(&event))
        take(now, *found, actions);
    if (std::holds_alternative<Tick>(event))
        return tick(now, actions);
    return Change::none;
}

Instant Session::next_deadline() const {
    if (ended_)
        return Instant::never();
    if (open_)
        return std::min(beat_due_, silent_at_);
    const Instant end = patient_ ? Instant::never() : looking_since_ + options_.connect_timeout;
    return std::min({hello_due_, look_due_, turn_ends_, end});
}

Session::Change Session::take(Instant now, const protocol::Welcome& welcome,
                              std::vector<Action>& actions) {
    if (open_ && welcome.broker == welcome_.broker && welcome.epoch == welcome_.epoch)
        return Change::none; // the answer to a hello that we repeated
    const bool first = welcome_.liveness == 0;
    learn(welcome.brokers);
    welcome_ = welcome;
    welcome_.liveness = std::clamp(welcome_.liveness, 1u, 1000u);
    heartbeat_ = std::clamp<Duration>(welcome_.heartbeat, 10ms, 1min);
    silence_max_ = heartbeat_ * welcome_.liveness * (1 << losses_);
    open_ = true;
    refusals_ = 0;
    refusal_.clear();
    if (!looked_at_.empty())
        actions.push_back(StopLooking{});
    opened_at_ = now;
    beat_due_ = now + heartbeat_;
    silent_at_ = silent_by(now);
    if (first || known_lost_)
        actions.push_back(News(ConnectionChanged{true, broker(), welcome_.stream, is_unproven()}));
    known_lost_ = false;
    return Change::opened;
}

Session::Change Session::take(Instant now, const protocol::Refused& refused,
                              std::vector<Action>& actions) {
    const bool is_another_version = refused.code == protocol::RefusalCode::version_mismatch;
    if (!open_ && (refused.code == protocol::RefusalCode::not_allowed ||
                   (is_another_version && has_sources())))
        return take_refusal(now, refused.reason, actions);
    if (is_another_version || refused.code == protocol::RefusalCode::not_allowed)
        return end(Change::refused, {ExitCode::refused, broker() + ": " + refused.reason});
    if (refused.code == protocol::RefusalCode::unknown_peer && open_) {
        open_ = false; // it restarted, or had lost us: same connection, new session
        looking_since_ = now;
        turn_ends_ = now + turn();
        say_hello(now, actions);
    }
    return Change::none;
}

/// An older broker refuses what is newer than itself, and by its answer says what it speaks: so it
/// is greeted in that. It may also say so once more, of what was said before that.
Session::Change Session::heed_older_version(Instant now, protocol::Version theirs,
                                            std::vector<Action>& actions) {
    if (theirs == spoken_)
        return Change::heeded;
    if (std::exchange(open_, false)) { // it has come in the place of a newer one
        looking_since_ = now;
        turn_ends_ = now + turn();
    }
    say_hello(now, actions, theirs);
    return Change::heeded;
}

/// Of several brokers another one may let us in, whose list was read later. Where they are found,
/// the right one may still come: whoever announces himself cannot end the search by saying no.
Session::Change Session::take_refusal(Instant now, const std::string& reason,
                                      std::vector<Action>& actions) {
    refusal_ = broker() + ": " + reason;
    if (++refusals_ >= brokers_.size() && !has_sources())
        return end(Change::refused, {ExitCode::refused, refusal_});
    next_turn(now, actions);
    return Change::none;
}

Session::Change Session::tick(Instant now, std::vector<Action>& actions) {
    if (open_ && now >= silent_at_) {
        losses_ = std::min(losses_ + 1, losses_max);
        lose(now, actions);
    } else if (open_) {
        if (now >= beat_due_) {
            actions.push_back(Send{protocol::Beat{}});
            beat_due_ = now + heartbeat_;
        }
        if (now - opened_at_ >= forgiven_after * silence_max_)
            losses_ = 0;
    } else if (!patient_ && now >= looking_since_ + options_.connect_timeout) {
        return give_up();
    } else if (now >= turn_ends_) {
        next_turn(now, actions);
    } else if (now >= look_due_) {
        look_at_source(now, actions);
    } else if (now >= hello_due_) {
        say_hello(now, actions);
    }
    return Change::none;
}

/// The next one's turn.
void Session::lose(Instant now, std::vector<Action>& actions) {
    open_ = false;
    known_lost_ = true;
    looking_since_ = now;
    actions.push_back(News(ConnectionChanged{false, broker(), {}}));
    next_turn(now, actions);
}

/// Who stands for the broker that speaks: endpoints; it does not say how we look for others. Those
/// that were given stay; the others are as the last word has them.
void Session::learn(const std::vector<protocol::Member>& brokers) {
    told_.clear();
    for (const protocol::Member& member : brokers)
        if (!member.endpoint.empty() && !discovery::is_source(member.endpoint) &&
            told_.size() < protocol::brokers_max)
            told_.push_back(member.endpoint);
    list_brokers();
}

/// A source is left as soon as it has somebody to be tried, or cannot have.
void Session::take(Instant now, const BrokersFound& found, std::vector<Action>& actions) {
    if (!has_sources() || std::ranges::count(options_.brokers, found.source) == 0)
        return;
    auto& known = found_[found.source];
    known = found.endpoints;
    if (known.size() > brokers_found_max)
        known.resize(brokers_found_max);
    list_brokers();
    if (broker() != found.source)
        return;
    trouble_ = found.trouble;
    if (!known.empty() || (!trouble_.empty() && brokers_.size() > 1))
        next_turn(now, actions);
}

/// Who we speak to stays, whatever is told of others.
void Session::list_brokers() {
    const std::string now = broker();
    brokers_.clear();
    const auto add = [this](const std::string& endpoint) {
        if (std::ranges::find(brokers_, endpoint) == brokers_.end())
            brokers_.push_back(endpoint);
    };
    for (const std::string& given : options_.brokers) {
        add(given);
        std::ranges::for_each(found_[given], add);
    }
    add(now);
    std::ranges::for_each(told_, add);
    broker_ = static_cast<std::size_t>(std::ranges::find(brokers_, now) - brokers_.begin());
}

void Session::next_turn(Instant now, std::vector<Action>& actions) {
    broker_ = (broker_ + 1) % brokers_.size();
    look_for_broker(now, actions);
}

void Session::look_for_broker(Instant now, std::vector<Action>& actions) {
    turn_ends_ = now + turn();
    hello_due_ = look_due_ = Instant::never();
    if (is_at_source()) {
        const auto last = looked_at_.find(broker());
        look_due_ = last == looked_at_.end() ? now : last->second + look_pause;
        if (look_due_ <= now)
            look_at_source(now, actions);
        return;
    }
    actions.push_back(Connect{broker()});
    hello_pause_ = hello_pause_first;
    say_hello(now, actions);
}

/// What was found the last time need not be there any more.
void Session::look_at_source(Instant now, std::vector<Action>& actions) {
    look_due_ = Instant::never();
    looked_at_[broker()] = now;
    trouble_.clear();
    actions.push_back(Look{broker()});
}

/// It begins with the newest version: the broker may be another one than the last time.
void Session::say_hello(Instant now, std::vector<Action>& actions, protocol::Version spoken) {
    speak(spoken, actions);
    actions.push_back(
        Send{protocol::ClientHello{options_.client_name, std::string(fraja::version)}});
    hello_due_ = now + hello_repeat;
}

void Session::speak(protocol::Version spoken, std::vector<Action>& actions) {
    if (std::exchange(spoken_, spoken) != spoken)
        actions.push_back(Speak{spoken});
}

/// How long one of several brokers is given. Alone it has all the time there is: ZeroMQ connects
/// again by itself.
Duration Session::turn() const {
    const auto count = static_cast<Duration::rep>(brokers_.size());
    if (count == 1)
        return Duration::max() / 2;
    return std::min<Duration>(is_at_source() ? source_turn_max : turn_max,
                              std::max<Duration>(options_.connect_timeout / count, 10ms));
}

/// When a broker that says nothing more is lost.
Instant Session::silent_by(Instant heard) const {
    return options_.is_in_process ? Instant::never() : heard + silence_max_;
}

bool Session::is_at_source() const {
    return discovery::is_source(broker());
}

bool Session::has_sources() const {
    return std::ranges::any_of(options_.brokers, discovery::is_source);
}

/// The DNS at least is somebody's whom this machine was told to ask. Who is told of by whoever
/// announced himself is no better known than he.
bool Session::is_unproven() const {
    const auto names = [this](const std::string& source) {
        const auto found = found_.find(source);
        return source == broker() || (source != discovery::beacon_source && found != found_.end() &&
                                      std::ranges::count(found->second, broker()) > 0);
    };
    return !options_.has_keys &&
           std::ranges::count(options_.brokers, discovery::beacon_source) > 0 &&
           std::ranges::none_of(options_.brokers, names);
}

Session::Change Session::give_up() {
    if (!refusal_.empty())
        return end(Change::refused, {ExitCode::refused, refusal_});
    std::string reason = "no broker answers at " + comma_list(brokers_);
    if (std::ranges::all_of(brokers_, discovery::is_source))
        reason = "no broker was found by " + comma_list(brokers_);
    if (trouble_.empty() && is_at_source() && broker() == discovery::beacon_source)
        trouble_ = discovery::nobody_announced;
    return end(Change::gave_up,
               {ExitCode::unreachable, trouble_.empty() ? reason : reason + ": " + trouble_});
}

Session::Change Session::end(Change change, Outcome outcome) {
    ended_ = true;
    open_ = false;
    failure_ = std::move(outcome);
    return change;
}

} // namespace fraja::client
