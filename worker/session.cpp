#include "worker/session.hpp"

#include "common/base/text.hpp"
#include "common/base/version.hpp"
#include "common/protocol/limits.hpp"

#include <algorithm>
#include <utility>

namespace fraja::worker {
namespace {

using protocol::FailureCode;
using protocol::RefusalCode;
using Stage = SceneOnShelf::Stage;

std::uint64_t seed_of(const WorkerId& id) {
    return std::hash<WorkerId>{}(id);
}

} // namespace

Session::Session(Identity identity, const Limits& limits)
    : identity_(std::move(identity)), limits_(limits), rng_(seed_of(identity_.worker)),
      hello_pause_(limits.hello_pause_min), shelf_(limits.shelf) {}

std::uint32_t credit_for(std::uint32_t threads, const Limits& limits) {
    const std::uint64_t tiles = threads * (1 + std::uint64_t{limits.prefetch_per_thread});
    return static_cast<std::uint32_t>(std::min<std::uint64_t>(tiles, protocol::credit_max));
}

void Session::step(Instant now, const Event& event, std::vector<Action>& actions) {
    if (state_ == State::over)
        return;
    Turn turn{now, actions};
    std::visit([&](const auto& e) { on(turn, e); }, event);
    settle(turn);
}

/// What follows of anything.
void Session::settle(Turn& turn) {
    tidy_shelf(turn);
    admit_waiting(turn);
    leave_when_done(turn);
}

Instant Session::next_deadline() const {
    if (state_ == State::over)
        return Instant::never();
    if (state_ == State::greeting)
        return next_hello_;
    if (state_ == State::stranded)
        return Instant::never();
    Instant deadline = std::min({next_beat_, silence_deadline(), leave_by_});
    for (const auto& [hash, scene] : shelf_.scenes())
        if (scene.stage == Stage::fetching)
            deadline = std::min(deadline, chunk_deadline(scene));
    return deadline;
}

// ------------------------------------------------------------------------- what the broker says

void Session::on(Turn& turn, const Received& event) {
    if (is_connected())
        heard_ = turn.now;
    if (heed_older_version(turn, event))
        return;
    std::visit([&](const auto& message) { on_message(turn, message); }, event.message);
}

/// An older broker refuses what is newer than itself, and by its answer says what it speaks: so it
/// is greeted in that. It may also say so once more, of what was said before that.
bool Session::heed_older_version(Turn& turn, const Received& event) {
    const auto* refused = std::get_if<protocol::Refused>(&event.message);
    if (!refused || refused->code != RefusalCode::version_mismatch ||
        event.version == protocol::version)
        return false;
    if (event.version == spoken_)
        return true;
    if (is_connected()) {
        turn.log(LogLevel::warning, "greeting_anew",
                 "an older broker has come in the place of this one: greeting anew");
        begin_greeting(turn);
        absence_said_ = true;
    }
    if (state_ != State::greeting)
        return true;
    unanswered_hellos_ -= unanswered_hellos_ > 0; // that is an answer
    hello(turn, event.version);
    return true;
}

void Session::on(Turn& turn, const Undecodable& event) {
    // A broker of another version refuses in its own version, which decode() refuses in turn.
    if (event.error.code == ErrorCode::version_mismatch && state_ == State::greeting) {
        turn.log(LogLevel::error, "wrong_version",
                 "cannot serve this broker: " + event.error.message);
        finish(turn, FinishReason::version_mismatch);
        return;
    }
    if (event.error.code == ErrorCode::refused) {
        absence_said_ = true; // it is there
        reception_ = std::max(reception_, Reception::refused);
        turn.log(LogLevel::warning, "turned_away",
                 "the broker does not let this worker in, will ask again: " + event.error.message);
        return;
    }
    note_oddity(turn, event.error.message);
}

void Session::on_message(Turn& turn, const protocol::Welcome& message) {
    const bool is_another = std::exchange(broker_, message.broker) != message.broker;
    if (is_another)
        last_attempt_.reset();
    // One that stands alone may begin with a lower term than the one before it.
    term_ = is_another && allies_.empty() ? message.term : std::max(term_, message.term);
    if (state_ == State::open) {
        // It has come twice, or a hello has. Of which session the broker is now is not known.
        turn.log(LogLevel::debug, "greeting_anew", "a Welcome without a hello: greeting anew");
        begin_greeting(turn);
        return;
    }
    if (is_leaving())
        return;
    if (message.incarnation != incarnation_ || unanswered_hellos_ == 0) {
        // It answers an earlier hello: the session that it opens ends when the broker hears the
        // last one, or the next.
        turn.log(LogLevel::debug, "old_welcome", "a Welcome to an earlier hello");
        return;
    }
    tiles_received_ = 0;
    turn.log(LogLevel::info, "connected",
             "connected: broker " + to_string(message.broker).substr(0, 8) + ", version " +
                 message.program_version +
                 (spoken_ < protocol::version ? ", by protocol version " + std::to_string(spoken_)
                                              : ""));
    state_ = State::open;
    reception_ = Reception::welcomed;
    heartbeat_ = std::clamp(message.heartbeat, limits_.heartbeat_min, limits_.heartbeat_max);
    liveness_ = std::clamp(message.liveness, 1u, limits_.liveness_max);
    heard_ = turn.now;
    next_beat_ = turn.now + heartbeat_;
    unanswered_beats_ = 0;
    hello_pause_ = limits_.hello_pause_min;
    unanswered_hellos_ = 0;
    absence_said_ = false;
}

void Session::on_message(Turn& turn, const protocol::Refused& message) {
    if (message.code == RefusalCode::version_mismatch) {
        turn.log(LogLevel::error, "wrong_version", "refused by the broker: " + message.reason);
        finish(turn, FinishReason::version_mismatch);
    } else if (!is_connected()) {
        // unknown_peer answers what was sent before the hello; anything else answers the hello,
        // which is tried again in its time.
        if (message.code == RefusalCode::unknown_peer)
            return;
        reception_ = std::max(reception_, Reception::refused);
        if (!std::exchange(absence_said_, true))
            turn.log(LogLevel::warning, "refused",
                     "refused by the broker, will ask again: " + message.reason);
    } else if (message.code == RefusalCode::not_allowed) {
        turn.log(LogLevel::warning, "refused",
                 "refused by the broker, will ask again: " + message.reason);
        begin_greeting(turn);
        absence_said_ = true;
    } else if (message.code == RefusalCode::unknown_peer) {
        turn.log(LogLevel::warning, "greeting_anew",
                 "the broker does not know this worker (any more): greeting anew");
        begin_greeting(turn);
    } else if (const auto asked = shelf_.oldest_ask(); message.code == RefusalCode::invalid &&
                                                       message.job == JobId{} &&
                                                       asked != shelf_.scenes().end()) {
        // It may have come twice, or what it answers has: so this scene is asked for again.
        const ContentHash scene = asked->first;
        if (asked->second.asks < limits_.chunk_asks_max)
            ask_chunk(turn, scene, asked->second);
        else
            fail_tiles_of(turn, scene, FailureCode::machine,
                          "the broker does not give the scene: " + message.reason);
    } else {
        note_oddity(turn, "refused: " + message.reason);
    }
}

void Session::on_message(Turn& turn, const protocol::Dismissed& message) {
    turn.log(LogLevel::warning, "dismissed", "told to leave: " + message.reason);
    finish(turn, FinishReason::dismissed);
}

void Session::on_message(Turn& turn, const protocol::Brokers& message) {
    if (!is_connected())
        return;
    hear_term(message.term);
    beat(turn);
}

/// A broker that stands alone begins none in the middle of a session.
void Session::hear_term(const protocol::Term& term) {
    is_of_several_ = is_of_several_ || term_ < term;
    term_ = std::max(term_, term);
}

void Session::on_message(Turn& turn, const protocol::Beat& message) {
    if (unanswered_beats_ > 0)
        --unanswered_beats_;
    if (message.leads)
        led_at_ = turn.now;
    else
        led_at_.reset();
}

template <class M>
void Session::on_message(Turn& turn, const M& message) {
    note_oddity(turn, std::string(message.name) + " has no place here");
}

void Session::on(Turn& turn, const CallerGone&) {
    if (is_connected())
        turn.log(LogLevel::info, "caller_gone", "the caller is gone");
    absence_said_ = false;
    unanswered_hellos_ = 0;
    last_attempt_.reset();
    begin_greeting(turn);
    next_hello_ = turn.now; // the next one has not been greeted yet
}

void Session::on(Turn& turn, const Tick& event) {
    note_progress(event.progress);
    keep_time(turn);
}

void Session::note_progress(const std::vector<TileProgress>& progress) {
    for (const auto& [ticket, rays] : progress)
        if (const auto at = tiles_.find(ticket); at != tiles_.end())
            at->second.rays = rays;
}

// ---------------------------------------------------------------------------- what the owner says

void Session::on(Turn& turn, const Drain&) {
    if (!is_leaving())
        begin_draining(turn, FinishReason::drained);
}

void Session::on(Turn& turn, const StopNow&) {
    begin_draining(turn, FinishReason::stopped);
    if (!tiles_.empty())
        turn.log(LogLevel::info, "hands_back",
                 "hands back " + counted(tiles_.size(), "tile") + " at hand");
    while (!tiles_.empty())
        fail_tile(turn, tiles_.begin(), FailureCode::cancelled, "this worker is leaving");
}

void Session::begin_draining(Turn& turn, FinishReason reason) {
    leave_reason_ = reason;
    if (state_ == State::greeting) {
        if (tiles_.empty())
            finish(turn, reason);
        else
            state_ = State::stranded;
    } else if (state_ == State::open) {
        state_ = State::draining;
        const bool finishes = reason == FinishReason::drained && !tiles_.empty();
        turn.log(LogLevel::info, "leaving",
                 "leaving with " + counted(tiles_.size(), "tile") + " at hand" +
                     (finishes ? "; a second INT or TERM hands them back at once" : ""));
        beat(turn); // before anything is handed back, or the broker would replace it
    }
}

/// A connection that ends while the broker answers a beat looks like a crash to it. So the last
/// word waits until every beat is answered; then it has heard all that was said before, too.
void Session::leave_when_done(Turn& turn) {
    if (state_ == State::stranded && tiles_.empty())
        return finish(turn, leave_reason_);
    if (state_ != State::draining || tiles_in_hand() > 0)
        return;
    leave_by_ = std::min(leave_by_, turn.now + limits_.farewell_max);
    if (unanswered_beats_ > 0 && turn.now < leave_by_)
        return;
    send(turn, protocol::Goodbye{});
    finish(turn, leave_reason_);
}

// --------------------------------------------------------------------------------- what allies say

void Session::look_again(Instant now, std::vector<Action>& actions) {
    if (state_ == State::over || (state_ == State::open && allies_.empty()))
        return;
    Turn turn{now, actions};
    if (!is_connected() && !has_connected_ally())
        drop_tiles(turn);
    settle(turn);
}

void Session::prepare_to_leave(Instant now, FinishReason reason, std::vector<Action>& actions) {
    Turn turn{now, actions};
    if (state_ != State::over)
        begin_draining(turn, reason);
}

void Session::greet_anew(Instant now, std::vector<Action>& actions) {
    Turn turn{now, actions};
    if (!is_connected())
        return;
    turn.log(LogLevel::debug, "greeting_anew", "greeting anew");
    begin_greeting(turn);
}

void Session::close(Instant now, std::vector<Action>& actions) {
    Turn turn{now, actions};
    if (is_connected())
        send(turn, protocol::Goodbye{});
    drop_tiles(turn);
    state_ = State::over;
}

bool Session::has_connected_ally() const {
    return std::ranges::any_of(allies_, [](const Session* ally) { return ally->is_connected(); });
}

protocol::Term Session::greatest_term() const {
    protocol::Term greatest = term_;
    for (const Session* ally : allies_)
        greatest = std::max(greatest, ally->term_);
    return greatest;
}

Duration Session::leader_silence(Instant now) const {
    const BrokerId leader = greatest_term().leader;
    Duration least = Duration::max();
    const auto consider = [&](const Session& session) {
        if (session.is_connected() && session.broker_ == leader && session.led_at_)
            least = std::min(least, now - *session.led_at_);
    };
    consider(*this);
    for (const Session* ally : allies_)
        consider(*ally);
    return least;
}

// ------------------------------------------------------------------------------------------- time

void Session::keep_time(Turn& turn) {
    if (is_connected() && turn.now >= silence_deadline()) {
        turn.log(LogLevel::warning, "broker_lost",
                 "the broker is silent: lost; greeting it until it answers");
        absence_said_ = true;
        begin_greeting(turn);
    }
    if (state_ == State::greeting && turn.now >= next_hello_) {
        if (identity_.is_called && unanswered_hellos_ >= limits_.hellos_per_turn)
            return hang_up(turn, false);
        hello(turn, protocol::version);
    }
    if (!is_connected())
        return;
    if (turn.now >= next_beat_)
        beat(turn);
    ask_overdue_chunks(turn);
}

/// It begins with the newest version: the broker may be another one than the last time.
void Session::hello(Turn& turn, protocol::Version spoken) {
    spoken_ = spoken;
    if (unanswered_hellos_ > 0 && !std::exchange(absence_said_, true))
        turn.log(LogLevel::warning, "broker_absent",
                 "the broker does not answer; asking again until it does (fraja-broker starts "
                 "one, -b names another, fraja-ctl doctor says what is wrong)");
    const double seconds_done = seconds(render_time_);
    const double speed =
        seconds_done > 0 ? static_cast<double>(rays_done_) / seconds_done * identity_.threads : 0.0;
    send(turn, protocol::WorkerHello{.worker = identity_.worker,
                                     .incarnation = ++incarnation_,
                                     .worker_name = identity_.name,
                                     .threads = identity_.threads,
                                     .credit = credit(),
                                     .speed_rays_per_s = speed,
                                     .memory_bytes = identity_.memory_bytes,
                                     .tags = identity_.tags,
                                     .program_version = std::string(version)});
    ++unanswered_hellos_;
    last_hello_ = turn.now;
    const double pause_s = seconds(hello_pause_) * rng_.between(0.5, 1.0);
    next_hello_ = turn.now + from_seconds(pause_s);
    hello_pause_ = std::min(2 * hello_pause_, limits_.hello_pause_max);
}

void Session::beat(Turn& turn) {
    protocol::WorkerBeat message{.credit = state_ == State::draining ? 0 : credit(),
                                 .in_flight = {},
                                 .tiles_received = tiles_received_,
                                 .term = greatest_term(),
                                 .leader_silence = leader_silence(turn.now)};
    list_tiles(message.in_flight);
    for (const Session* ally : allies_)
        ally->list_tiles(message.in_flight);
    send(turn, std::move(message));
    ++unanswered_beats_;
    next_beat_ = turn.now + heartbeat_;
}

/// CallerGone comes before anything else.
void Session::hang_up(Turn& turn, bool for_good) {
    drop_tiles(turn);
    state_ = State::greeting;
    turn.actions.emplace_back(HangUp{for_good});
}

/// The session is gone. A worker that is leaving has nobody left to answer, but allies' brokers.
void Session::begin_greeting(Turn& turn) {
    drop_what_no_ally_wants(turn);
    if (is_leaving()) {
        if (tiles_.empty())
            finish(turn, leave_reason_);
        else
            state_ = State::stranded;
        return;
    }
    state_ = State::greeting;
    hello_pause_ = limits_.hello_pause_min;
    // A broker that welcomes and forgets by turns is not greeted faster than an absent one.
    next_hello_ = std::max(turn.now, last_hello_ + limits_.hello_pause_min);
}

void Session::finish(Turn& turn, FinishReason reason) {
    if (reason == FinishReason::version_mismatch)
        drop_what_no_ally_wants(turn);
    else
        drop_tiles(turn);
    const bool broker_s_wish =
        reason == FinishReason::version_mismatch || reason == FinishReason::dismissed;
    if (identity_.is_called && broker_s_wish && state_ != State::draining)
        return hang_up(turn, true);
    if (!tiles_.empty()) {
        leave_reason_ = reason;
        state_ = State::stranded;
        return;
    }
    state_ = State::over;
    turn.actions.emplace_back(Finished{reason});
}

/// What should not happen and harms nobody.
void Session::note_oddity(Turn& turn, const std::string& what) {
    turn.log(LogLevel::warning, "oddity",
             "oddity: " + std::string(clipped(what, protocol::string_bytes_max)));
}

} // namespace fraja::worker
