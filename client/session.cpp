#include "client/session.hpp"

#include "common/base/text.hpp"
#include "common/base/version.hpp"
#include "common/protocol/limits.hpp"

#include <algorithm>
#include <utility>

namespace fraja::client {
namespace {

using namespace std::chrono_literals;

constexpr Duration hello_repeat = 1s;        // unanswered
constexpr Duration hello_pause_first = 10ms; // not even sent: the connection is being made
constexpr Duration hello_pause_max = 500ms;
constexpr Duration turn_max = 2s;  // for one of several brokers
constexpr int losses_max = 3;      // as often the silence that is borne is doubled
constexpr int forgiven_after = 10; // times as long as that: losses are forgotten

} // namespace

Session::Session(SessionOptions options)
    : options_(std::move(options)), named_(options_.brokers.size()) {
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
        if (!open_) {
            hello_due_ = now + hello_pause_;
            hello_pause_ = std::min(2 * hello_pause_, hello_pause_max);
        } else if (options_.brokers.size() > 1) {
            lose(now, actions); // the connection is gone, and there are others
        }
        return Change::none;
    }
    if (const auto* away = std::get_if<TurnedAway>(&event))
        return open_ ? Change::none : take_refusal(now, away->reason, actions);
    if (const auto* bad = std::get_if<Undecodable>(&event)) {
        if (bad->error.code == ErrorCode::version_mismatch)
            return end(Change::refused, {ExitCode::refused, broker() + ": " + bad->error.message});
        return Change::none;
    }
    if (const auto* from = std::get_if<FromBroker>(&event)) {
        silent_at_ = open_ ? now + silence_max_ : Instant::never();
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
    return std::min({hello_due_, turn_ends_, end});
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
    opened_at_ = now;
    beat_due_ = now + heartbeat_;
    silent_at_ = now + silence_max_;
    if (first || known_lost_)
        actions.push_back(News(ConnectionChanged{true, broker(), welcome_.stream}));
    known_lost_ = false;
    return Change::opened;
}

Session::Change Session::take(Instant now, const protocol::Refused& refused,
                              std::vector<Action>& actions) {
    if (refused.code == protocol::RefusalCode::not_allowed && !open_)
        return take_refusal(now, refused.reason, actions);
    if (refused.code == protocol::RefusalCode::version_mismatch ||
        refused.code == protocol::RefusalCode::not_allowed)
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

/// Of several brokers another one may let us in, whose list was read later.
Session::Change Session::take_refusal(Instant now, const std::string& reason,
                                      std::vector<Action>& actions) {
    if (++refusals_ >= options_.brokers.size())
        return end(Change::refused, {ExitCode::refused, broker() + ": " + reason});
    broker_ = (broker_ + 1) % options_.brokers.size();
    look_for_broker(now, actions);
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
        return end(Change::gave_up,
                   {ExitCode::unreachable, "no broker answers at " + comma_list(options_.brokers)});
    } else if (now >= turn_ends_) {
        broker_ = (broker_ + 1) % options_.brokers.size();
        look_for_broker(now, actions);
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
    broker_ = (broker_ + 1) % options_.brokers.size();
    look_for_broker(now, actions);
}

/// Who stands for the broker that speaks. Those that were given stay; the others are as the last
/// word has them.
void Session::learn(const std::vector<protocol::Member>& brokers) {
    const std::string now = broker();
    options_.brokers.resize(named_);
    const auto add = [&](const std::string& endpoint) {
        if (!endpoint.empty() && options_.brokers.size() < named_ + protocol::brokers_max &&
            std::ranges::find(options_.brokers, endpoint) == options_.brokers.end())
            options_.brokers.push_back(endpoint);
    };
    add(now);
    for (const protocol::Member& member : brokers)
        add(member.endpoint);
    broker_ = static_cast<std::size_t>(std::ranges::find(options_.brokers, now) -
                                       options_.brokers.begin());
}

void Session::look_for_broker(Instant now, std::vector<Action>& actions) {
    actions.push_back(Connect{broker()});
    hello_pause_ = hello_pause_first;
    turn_ends_ = now + turn();
    say_hello(now, actions);
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
    const auto count = static_cast<Duration::rep>(options_.brokers.size());
    if (count == 1)
        return Duration::max() / 2;
    return std::min<Duration>(turn_max, std::max<Duration>(options_.connect_timeout / count, 10ms));
}

Session::Change Session::end(Change change, Outcome outcome) {
    ended_ = true;
    open_ = false;
    failure_ = std::move(outcome);
    return change;
}

} // namespace fraja::client
