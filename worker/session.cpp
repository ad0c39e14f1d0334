#include "worker/session.hpp"

#include "common/base/assert.hpp"
#include "common/base/text.hpp"
#include "common/base/version.hpp"
#include "common/protocol/limits.hpp"
#include "common/protocol/probe.hpp"

#include <algorithm>
#include <bit>
#include <string_view>
#include <utility>

namespace fraja::worker {
namespace {

using protocol::FailureCode;
using protocol::RefusalCode;
using Stage = SceneOnShelf::Stage;

/// So much of a text as a message may carry.
std::string sendable(std::string_view text) {
    return std::string(clipped(text, protocol::string_bytes_max));
}

std::string short_name(const ContentHash& scene) {
    return "scene " + to_string(scene).substr(0, 12);
}

std::string name_of(const protocol::RenderTile& order) {
    return "tile " + std::to_string(static_cast<std::uint32_t>(order.tile)) + " of job " +
           to_string(order.job).substr(0, 8);
}

std::uint64_t seed_of(const WorkerId& id) {
    return std::hash<WorkerId>{}(id);
}

FailureCode failure_of(ErrorCode code) {
    switch (code) {
    case ErrorCode::invalid_scene:
    case ErrorCode::unresolved_overlap:
    case ErrorCode::limit_exceeded:
        return FailureCode::scene;
    case ErrorCode::cancelled:
        return FailureCode::cancelled;
    default:
        return FailureCode::machine;
    }
}

/// What a sound broker never sends.
Result<void> validate(const protocol::RenderTile& order) {
    if (auto valid = protocol::validate(order.settings); !valid)
        return valid;
    const PixelRect& r = order.rect;
    const auto invalid = [](std::string why) {
        return Error{ErrorCode::invalid_argument, std::move(why)};
    };
    if (order.probe_side > 0) {
        const std::uint64_t squares = protocol::probe_squares(r, order.probe_side);
        if (squares == 0 || squares > protocol::probe_squares_max)
            return invalid("the probe has " + std::to_string(squares) + " squares: 1 to " +
                           std::to_string(protocol::probe_squares_max));
    } else if (r.empty() || r.width > protocol::tile_side_max || r.height > protocol::tile_side_max)
        return invalid("the tile is " + std::to_string(r.width) + "x" + std::to_string(r.height) +
                       " pixels: 1 to " + std::to_string(protocol::tile_side_max) + " a side");
    if (!r.inside(order.settings.crop))
        return invalid("the tile is not within the crop");
    if (order.scene_bytes > protocol::scene_bytes_max)
        return invalid("the scene has more than " + std::to_string(protocol::scene_bytes_max) +
                       " bytes");
    return {};
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
    tidy_shelf(turn);
    admit_waiting(turn);
    leave_when_done(turn);
}

Instant Session::next_deadline() const {
    if (state_ == State::over)
        return Instant::never();
    if (state_ == State::greeting)
        return next_hello_;
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
    std::visit([&](const auto& message) { on_message(turn, message); }, event.message);
}

void Session::on(Turn& turn, const Undecodable& event) {
    // A broker of another version refuses in its own version, which decode() refuses in turn.
    if (event.error.code == ErrorCode::version_mismatch && state_ == State::greeting) {
        turn.log(LogLevel::error, "cannot serve this broker: " + event.error.message);
        finish(turn, FinishReason::version_mismatch);
        return;
    }
    count_oddity(turn, event.error.message);
}

void Session::on_message(Turn& turn, const protocol::Welcome& message) {
    if (message.incarnation != incarnation_) {
        // It answers an earlier hello: the session that it opens ends when the broker hears the
        // last one.
        turn.log(LogLevel::debug, "a Welcome to an earlier hello");
        return;
    }
    drop_tiles(turn);
    tiles_received_ = 0;
    if (!is_connected())
        turn.log(LogLevel::info, "connected: broker " + to_string(message.broker).substr(0, 8) +
                                     ", version " + message.program_version);
    if (state_ == State::greeting)
        state_ = State::open;
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
        turn.log(LogLevel::error, "refused by the broker: " + message.reason);
        finish(turn, FinishReason::version_mismatch);
    } else if (!is_connected()) {
        // unknown_peer answers what was sent before the hello; anything else answers the hello,
        // which is tried again in its time.
        if (message.code != RefusalCode::unknown_peer && !std::exchange(absence_said_, true))
            turn.log(LogLevel::warning, "refused by the broker, will ask again: " + message.reason);
    } else if (message.code == RefusalCode::unknown_peer) {
        turn.log(LogLevel::warning,
                 "the broker does not know this worker (any more): greeting anew");
        begin_greeting(turn);
    } else if (const auto asked = shelf_.oldest_ask(); message.code == RefusalCode::invalid &&
                                                       message.job == JobId{} &&
                                                       asked != shelf_.scenes().end()) {
        const ContentHash scene = asked->first;
        fail_tiles_of(turn, scene, FailureCode::machine,
                      "the broker does not give the scene: " + message.reason);
    } else {
        count_oddity(turn, "refused: " + message.reason);
    }
}

void Session::on_message(Turn& turn, const protocol::Dismissed& message) {
    turn.log(LogLevel::warning, "told to leave: " + message.reason);
    finish(turn, FinishReason::dismissed);
}

void Session::on_message(Turn&, const protocol::Beat&) {
    if (unanswered_beats_ > 0)
        --unanswered_beats_;
}

void Session::on_message(Turn& turn, const protocol::Chunk& message) {
    SceneOnShelf* scene = shelf_.find(message.blob);
    if (!is_connected() || !scene || scene->stage != Stage::fetching ||
        message.offset_bytes != scene->fetched_bytes || message.blobs.size() != 1) {
        turn.log(LogLevel::debug, "a chunk that is not waited for, of " + short_name(message.blob));
        return;
    }
    const std::uint64_t chunk_bytes = message.blobs[0]->size();
    const std::uint64_t rest_bytes = scene->total_bytes - scene->fetched_bytes;
    if (message.total_bytes != scene->total_bytes ||
        chunk_bytes != std::min<std::uint64_t>(rest_bytes, protocol::chunk_bytes)) {
        fail_tiles_of(turn, message.blob, FailureCode::machine,
                      "the scene came in chunks of a wrong size");
        return;
    }
    scene->chunks.push_back(message.blobs[0]);
    scene->fetched_bytes += chunk_bytes;
    scene->asks = 0;
    if (scene->fetched_bytes < scene->total_bytes) {
        ask_chunk(turn, message.blob, *scene);
        return;
    }
    scene->stage = Stage::compiling;
    turn.log(LogLevel::debug, "fetched " + short_name(message.blob) + ", " +
                                  std::to_string(scene->total_bytes) + " bytes");
    const auto first = std::ranges::find_if(
        tiles_, [&](const auto& entry) { return entry.second.order.scene == message.blob; });
    FRAJA_ASSERT(first != tiles_.end()); // a scene is fetched only for as long as a tile needs it
    turn.actions.emplace_back(CompileScene{message.blob, std::exchange(scene->chunks, {}),
                                           first->second.order.settings.kernel});
}

void Session::on_message(Turn& turn, const protocol::RenderTile& message) {
    if (!is_connected()) {
        // Of the session that was given up: the broker has requeued it, or will at our hello.
        turn.log(LogLevel::debug, name_of(message) + " came without a session");
        return;
    }
    ++tiles_received_;
    if (find_tile(message.job, message.tile, message.attempt) != tiles_.end()) {
        count_oddity(turn, name_of(message) + " came twice");
        return;
    }
    const auto refuse = [&](FailureCode code, const std::string& reason) {
        turn.send(protocol::TileFailed{message.job, message.tile, message.attempt, code,
                                       sendable(reason)});
    };
    if (state_ == State::draining)
        return refuse(FailureCode::cancelled, "this worker is leaving");
    if (tiles_.size() >= credit()) {
        count_oddity(turn, name_of(message) + " is beyond the credit");
        return refuse(FailureCode::machine, "beyond this worker's credit");
    }
    if (const auto valid = validate(message); !valid) {
        count_oddity(turn, name_of(message) + ": " + valid.error().message);
        return refuse(FailureCode::machine, valid.error().message);
    }
    ++waiting_count_;
    admit(turn, tiles_.emplace(Ticket{++tickets_}, Tile{.order = message}).first);
}

/// Starts it, or has its scene fetched. Scenes that nobody needs any more may still be compiled:
/// where there are too many of them it waits.
void Session::admit(Turn& turn, Tiles::iterator at) {
    Tile& tile = at->second;
    const protocol::RenderTile& order = tile.order;
    const SceneOnShelf* known = shelf_.find(order.scene);
    if (known && known->total_bytes != order.scene_bytes)
        return fail_tile(turn, at, FailureCode::machine,
                         "the scene's size is not the one told before");
    if (known && known->stage == Stage::refused)
        return fail_tile(turn, at, FailureCode::scene, std::string(known->reason));
    if (!known && shelf_.scenes().size() >= credit() + limits_.shelf.idle_count_max)
        return;
    tile.holds_scene = true;
    --waiting_count_;
    SceneOnShelf& scene = shelf_.use(order.scene, order.scene_bytes);
    if (scene.stage == Stage::ready)
        start_tile(turn, at->first, tile);
    else if (!known)
        ask_chunk(turn, order.scene, scene);
}

void Session::admit_waiting(Turn& turn) {
    if (waiting_count_ == 0)
        return;
    for (auto at = tiles_.begin(); at != tiles_.end();) {
        const auto next = std::next(at);
        if (!at->second.holds_scene)
            admit(turn, at);
        at = next;
    }
}

void Session::on_message(Turn& turn, const protocol::CancelTile& message) {
    const auto at = find_tile(message.job, message.tile, message.attempt);
    if (at == tiles_.end())
        return; // it was answered before this came
    turn.log(LogLevel::debug, name_of(at->second.order) + ": cancelled by the broker");
    fail_tile(turn, at, FailureCode::cancelled, "cancelled by the broker");
}

template <class M>
void Session::on_message(Turn& turn, const M& message) {
    count_oddity(turn, std::string(message.name) + " has no place here");
}

// ------------------------------------------------------------------ what the render threads say

void Session::on(Turn& turn, const SceneCompiled& event) {
    SceneOnShelf* scene = shelf_.find(event.scene);
    if (!scene || scene->stage != Stage::compiling)
        return;
    scene->stage = Stage::ready;
    for (auto& [ticket, tile] : tiles_)
        if (tile.order.scene == event.scene && tile.holds_scene)
            start_tile(turn, ticket, tile);
}

void Session::on(Turn& turn, const SceneFailed& event) {
    SceneOnShelf* scene = shelf_.find(event.scene);
    if (!scene || scene->stage != Stage::compiling)
        return;
    turn.log(LogLevel::warning, short_name(event.scene) + ": " + event.error.message);
    const FailureCode code = failure_of(event.error.code);
    if (code == FailureCode::scene) { // remembered: tiles under way need not fetch it again
        scene->stage = Stage::refused;
        scene->reason = event.error.message;
    }
    fail_tiles_of(turn, event.scene, code, event.error.message);
}

void Session::on(Turn& turn, const TileFinished& event) {
    const auto at = tiles_.find(event.ticket);
    if (at == tiles_.end())
        return;
    rays_done_ += event.rays.total();
    render_time_ += event.elapsed;
    const protocol::RenderTile& order = at->second.order;
    turn.log(LogLevel::debug,
             name_of(order) + ": done in " + std::to_string(seconds(event.elapsed)) + " s");
    turn.send(protocol::TileRendered{order.job, order.tile, order.attempt, event.rays,
                                     event.elapsed, event.blobs});
    at->second.started = false; // nothing is left to stop
    forget_tile(turn, at);
}

void Session::on(Turn& turn, const TileBroken& event) {
    const auto at = tiles_.find(event.ticket);
    if (at == tiles_.end())
        return;
    const FailureCode code = failure_of(event.error.code);
    if (code != FailureCode::cancelled)
        turn.log(LogLevel::warning, name_of(at->second.order) + ": " + event.error.message);
    at->second.started = false;
    fail_tile(turn, at, code, event.error.message);
}

void Session::on(Turn& turn, const CallerGone&) {
    if (is_connected())
        turn.log(LogLevel::info, "the caller is gone");
    absence_said_ = false;
    unanswered_hellos_ = 0;
    begin_greeting(turn);
    next_hello_ = turn.now; // the next one has not been greeted yet
}

void Session::on(Turn& turn, const Tick& event) {
    for (const TileProgress& progress : event.progress)
        if (const auto at = tiles_.find(progress.ticket); at != tiles_.end())
            at->second.rays = progress.rays;
    keep_time(turn);
}

// ---------------------------------------------------------------------------- what the owner says

void Session::on(Turn& turn, const Drain&) {
    if (state_ != State::draining)
        begin_draining(turn, FinishReason::drained);
}

void Session::on(Turn& turn, const StopNow&) {
    begin_draining(turn, FinishReason::stopped);
    while (!tiles_.empty())
        fail_tile(turn, tiles_.begin(), FailureCode::cancelled, "this worker is leaving");
}

void Session::begin_draining(Turn& turn, FinishReason reason) {
    leave_reason_ = reason;
    if (state_ == State::greeting) {
        finish(turn, reason);
    } else if (state_ == State::open) {
        state_ = State::draining;
        turn.log(LogLevel::info,
                 "leaving with " + std::to_string(tiles_.size()) + " tiles at hand");
        beat(turn); // before anything is handed back, or the broker would replace it
    }
}

/// A connection that ends while the broker answers a beat looks like a crash to it. So the last
/// word waits until every beat is answered; then it has heard all that was said before, too.
void Session::leave_when_done(Turn& turn) {
    if (state_ != State::draining || !tiles_.empty())
        return;
    leave_by_ = std::min(leave_by_, turn.now + limits_.farewell_max);
    if (unanswered_beats_ > 0 && turn.now < leave_by_)
        return;
    turn.send(protocol::Goodbye{});
    finish(turn, leave_reason_);
}

// ------------------------------------------------------------------------------------------- time

void Session::keep_time(Turn& turn) {
    if (is_connected() && turn.now >= silence_deadline()) {
        turn.log(LogLevel::warning, "the broker is silent: lost; greeting it until it answers");
        absence_said_ = true;
        begin_greeting(turn);
    }
    if (state_ == State::greeting && turn.now >= next_hello_) {
        if (identity_.is_called && unanswered_hellos_ >= limits_.hellos_per_turn)
            return hang_up(turn, false);
        hello(turn);
    }
    if (!is_connected())
        return;
    if (turn.now >= next_beat_)
        beat(turn);
    ask_overdue_chunks(turn);
}

void Session::hello(Turn& turn) {
    if (unanswered_hellos_ > 0 && !std::exchange(absence_said_, true))
        turn.log(LogLevel::warning, "the broker does not answer; asking again until it does");
    const double seconds_done = seconds(render_time_);
    const double speed =
        seconds_done > 0 ? static_cast<double>(rays_done_) / seconds_done * identity_.threads : 0.0;
    turn.send(protocol::WorkerHello{.worker = identity_.worker,
                                    .incarnation = ++incarnation_,
                                    .worker_name = identity_.name,
                                    .threads = identity_.threads,
                                    .credit = credit(),
                                    .speed_rays_per_s = speed,
                                    .memory_bytes = 0,
                                    .tags = identity_.tags,
                                    .program_version = std::string(version)});
    ++unanswered_hellos_;
    last_hello_ = turn.now;
    const double pause_s = seconds(hello_pause_) * rng_.between(0.5, 1.0);
    next_hello_ =
        turn.now + std::chrono::duration_cast<Duration>(std::chrono::duration<double>(pause_s));
    hello_pause_ = std::min(2 * hello_pause_, limits_.hello_pause_max);
}

void Session::beat(Turn& turn) {
    protocol::WorkerBeat message{.credit = state_ == State::draining ? 0 : credit(),
                                 .in_flight = {},
                                 .tiles_received = tiles_received_};
    for (const auto& [ticket, tile] : tiles_)
        message.in_flight.push_back(
            {tile.order.job, tile.order.tile, tile.order.attempt, tile.rays});
    turn.send(std::move(message));
    ++unanswered_beats_;
    next_beat_ = turn.now + heartbeat_;
}

/// CallerGone comes before anything else.
void Session::hang_up(Turn& turn, bool for_good) {
    drop_tiles(turn);
    state_ = State::greeting;
    turn.actions.emplace_back(HangUp{for_good});
}

/// The session is gone. A worker that is leaving has nobody left to answer.
void Session::begin_greeting(Turn& turn) {
    drop_tiles(turn);
    if (state_ == State::draining) {
        finish(turn, leave_reason_);
        return;
    }
    state_ = State::greeting;
    hello_pause_ = limits_.hello_pause_min;
    // A broker that welcomes and forgets by turns is not greeted faster than an absent one.
    next_hello_ = std::max(turn.now, last_hello_ + limits_.hello_pause_min);
}

void Session::finish(Turn& turn, FinishReason reason) {
    drop_tiles(turn);
    const bool broker_s_wish =
        reason == FinishReason::version_mismatch || reason == FinishReason::dismissed;
    if (identity_.is_called && broker_s_wish && state_ != State::draining)
        return hang_up(turn, true);
    state_ = State::over;
    turn.actions.emplace_back(Finished{reason});
}

// ----------------------------------------------------------------------------------------- scenes

void Session::ask_chunk(Turn& turn, const ContentHash& hash, SceneOnShelf& scene) {
    shelf_.note_ask(scene, turn.now);
    turn.send(protocol::NeedChunk{hash, scene.fetched_bytes});
}

void Session::ask_overdue_chunks(Turn& turn) {
    std::vector<ContentHash> given_up;
    for (auto& [hash, scene] : shelf_.scenes()) {
        if (scene.stage != Stage::fetching || turn.now < chunk_deadline(scene))
            continue;
        if (scene.asks < limits_.chunk_asks_max)
            ask_chunk(turn, hash, scene);
        else
            given_up.push_back(hash);
    }
    for (const ContentHash& hash : given_up)
        fail_tiles_of(turn, hash, FailureCode::machine,
                      "the broker does not send the scene, asked " +
                          std::to_string(limits_.chunk_asks_max) + " times");
}

void Session::tidy_shelf(Turn& turn) {
    for (const ContentHash& hash : shelf_.take_surplus())
        turn.actions.emplace_back(ForgetScene{hash});
}

// ------------------------------------------------------------------------------------------ tiles

Session::Tiles::iterator Session::find_tile(JobId job, TileIndex tile, AttemptNumber attempt) {
    return std::ranges::find_if(tiles_, [&](const auto& entry) {
        const protocol::RenderTile& order = entry.second.order;
        return order.tile == tile && order.attempt == attempt && order.job == job;
    });
}

void Session::start_tile(Turn& turn, Ticket ticket, Tile& tile) {
    tile.started = true;
    turn.actions.emplace_back(StartTile{ticket, tile.order.scene, tile.order.pass, tile.order.rect,
                                        tile.order.settings, tile.order.probe_side});
}

/// Stops what runs; the answer, if one is due, was sent before.
Session::Tiles::iterator Session::forget_tile(Turn& turn, Tiles::iterator at) {
    if (at->second.started)
        turn.actions.emplace_back(StopTile{at->first});
    if (at->second.holds_scene)
        shelf_.release(at->second.order.scene);
    else
        --waiting_count_;
    return tiles_.erase(at);
}

/// Without a word: the session they belong to is gone.
void Session::drop_tiles(Turn& turn) {
    for (auto at = tiles_.begin(); at != tiles_.end();)
        at = forget_tile(turn, at);
}

void Session::fail_tile(Turn& turn, Tiles::iterator at, FailureCode code,
                        const std::string& reason) {
    const protocol::RenderTile& order = at->second.order;
    turn.send(protocol::TileFailed{order.job, order.tile, order.attempt, code, sendable(reason)});
    forget_tile(turn, at);
}

/// Every tile that waits for the scene fails. Unless the scene is kept as refused, it is forgotten,
/// so that the next tile tries anew.
void Session::fail_tiles_of(Turn& turn, const ContentHash& scene, FailureCode code,
                            const std::string& reason) {
    const ContentHash hash = scene; // the argument may live in what is erased below
    const std::string why = reason;
    for (auto at = tiles_.begin(); at != tiles_.end();) {
        const auto next = std::next(at);
        if (at->second.order.scene == hash)
            fail_tile(turn, at, code, why);
        at = next;
    }
    if (const SceneOnShelf* left = shelf_.find(hash); left && left->stage != Stage::refused)
        shelf_.erase(hash);
}

/// What should not happen and harms nobody: said at the first, second, fourth, eighth … time.
void Session::count_oddity(Turn& turn, const std::string& what) {
    if (std::has_single_bit(++oddities_))
        turn.log(LogLevel::warning, sendable(what) + " (oddity " + std::to_string(oddities_) + ")");
}

} // namespace fraja::worker
