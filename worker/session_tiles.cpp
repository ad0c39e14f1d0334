// Session: the tiles at hand and the scenes that they need.
#include "common/base/assert.hpp"
#include "common/base/text.hpp"
#include "common/protocol/limits.hpp"
#include "common/protocol/probe.hpp"
#include "worker/session.hpp"

#include <algorithm>
#include <string_view>
#include <utility>

namespace fraja::worker {
namespace {

using protocol::FailureCode;
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

/// As answers and beats tell it.
PixelRect rect_told(const protocol::RenderTile& order) {
    return order.probe_side > 0 ? PixelRect{} : order.rect;
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

/// Whether a broker has counted `attempt` before `last`, or at it. Its count comes round in the
/// end.
bool is_up_to(AttemptNumber last, AttemptNumber attempt) {
    constexpr std::uint32_t remembered = 1u << 20;
    return static_cast<std::uint32_t>(last) - static_cast<std::uint32_t>(attempt) < remembered;
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

// ------------------------------------------------------------------------- what the broker says

void Session::on_message(Turn& turn, const protocol::Chunk& message) {
    SceneOnShelf* scene = shelf_.find(message.blob);
    if (!is_connected() || !scene || scene->stage != Stage::fetching ||
        message.offset_bytes != scene->fetched_bytes || message.blobs.size() != 1) {
        turn.log(LogLevel::debug, "chunk_unwanted",
                 "a chunk that is not waited for, of " + short_name(message.blob));
        return;
    }
    const std::uint64_t chunk_bytes = message.blobs[0].size();
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
    turn.log(LogLevel::debug, "scene_fetched",
             "fetched " + short_name(message.blob) + ", " + counted(scene->total_bytes, "byte"));
    const auto first = std::ranges::find_if(
        tiles_, [&](const auto& entry) { return entry.second.order.scene == message.blob; });
    FRAJA_ASSERT(first != tiles_.end()); // a scene is fetched only for as long as a tile needs it
    turn.actions.emplace_back(CompileScene{message.blob, std::exchange(scene->chunks, {}),
                                           first->second.order.settings.kernel});
}

void Session::on_message(Turn& turn, const protocol::RenderTile& message) {
    const bool came_before = last_attempt_ && is_up_to(*last_attempt_, message.attempt);
    if (!came_before)
        last_attempt_ = message.attempt;
    if (!is_connected()) {
        // Of the session that was given up: the broker has requeued it, or will at our hello.
        turn.log(LogLevel::debug, "tile_unwanted", name_of(message) + " came without a session");
        return;
    }
    // It is here, or was answered. (Of a broker whose count leaps, what is here may come later.)
    if (came_before || find_tile(message.job, message.tile, message.attempt) != tiles_.end()) {
        note_oddity(turn, name_of(message) + " came twice");
        return;
    }
    ++tiles_received_;
    const auto refuse = [&](FailureCode code, const std::string& reason) {
        send(turn, protocol::TileFailed{message.job, message.tile, message.attempt, code,
                                        sendable(reason)});
    };
    if (!allies_.empty() && message.term < greatest_term()) {
        // Counted, and named by no beat: so its broker has it back, and hears who leads now.
        turn.log(LogLevel::debug, "tile_of_old_term",
                 name_of(message) + " is of a broker that leads no more");
        return beat(turn);
    }
    hear_term(message.term);
    if (state_ == State::draining)
        return refuse(FailureCode::cancelled, "this worker is leaving");
    if (const protocol::RenderTile* known = find_at_allies(message)) {
        if (known->pass == message.pass && known->rect == message.rect && known->probe_side == 0 &&
            message.probe_side == 0)
            return; // its answer goes to all
        note_oddity(turn, name_of(message) + " bears another tile's name");
        return refuse(FailureCode::machine, "another tile of this name is at hand");
    }
    // While one broker takes over from another, or from itself, both may have filled the credit.
    if (tiles_in_hand() >= (is_of_several_ ? 2 : 1) * std::size_t{credit()}) {
        note_oddity(turn, name_of(message) + " is beyond the credit");
        if (is_of_several_) // its broker did not know of these: it is not to blame
            return beat(turn);
        return refuse(FailureCode::machine, "beyond this worker's credit");
    }
    if (const auto valid = validate(message); !valid) {
        note_oddity(turn, name_of(message) + ": " + valid.error().message);
        return refuse(FailureCode::machine, valid.error().message);
    }
    ++waiting_count_;
    admit(turn, tiles_.emplace(next_ticket(), Tile{.order = message}).first);
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
    if (is_connected() && at != tiles_.end()) // or it was answered before this came
        cancel(turn, at);
}

bool Session::cancel(Instant now, const protocol::CancelTile& tile, std::vector<Action>& actions) {
    const auto at = find_tile(tile.job, tile.tile, tile.attempt);
    if (at == tiles_.end())
        return false;
    Turn turn{now, actions};
    cancel(turn, at);
    settle(turn);
    return true;
}

void Session::cancel(Turn& turn, Tiles::iterator at) {
    turn.log(LogLevel::debug, "tile_cancelled",
             name_of(at->second.order) + ": cancelled by the broker");
    fail_tile(turn, at, FailureCode::cancelled, "cancelled by the broker");
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
    turn.log(LogLevel::warning, "scene_failed",
             short_name(event.scene) + ": " + event.error.message);
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
    turn.log(LogLevel::debug, "tile_done",
             name_of(order) + ": done in " + std::to_string(seconds(event.elapsed)) + " s");
    answer(turn, order,
           protocol::TileRendered{order.job, order.tile, order.attempt, event.rays, event.elapsed,
                                  order.pass, rect_told(order), event.blobs});
    at->second.started = false; // nothing is left to stop
    forget_tile(turn, at);
}

void Session::on(Turn& turn, const TileBroken& event) {
    const auto at = tiles_.find(event.ticket);
    if (at == tiles_.end())
        return;
    const FailureCode code = failure_of(event.error.code);
    if (code != FailureCode::cancelled)
        turn.log(LogLevel::warning, "tile_failed",
                 name_of(at->second.order) + ": " + event.error.message);
    at->second.started = false;
    fail_tile(turn, at, code, event.error.message);
}

// ----------------------------------------------------------------------------------------- scenes

void Session::ask_chunk(Turn& turn, const ContentHash& hash, SceneOnShelf& scene) {
    shelf_.note_ask(scene, turn.now);
    send(turn, protocol::NeedChunk{hash, scene.fetched_bytes});
}

void Session::ask_overdue_chunks(Turn& turn) {
    std::vector<std::pair<ContentHash, std::uint32_t>> given_up; // and how often it was asked for
    for (auto& [hash, scene] : shelf_.scenes()) {
        if (scene.stage != Stage::fetching || turn.now < chunk_deadline(scene))
            continue;
        // Who comes that late has stood still, and not read what may have been answered.
        const bool late = turn.now > chunk_deadline(scene) + heartbeat_;
        if (scene.asks < limits_.chunk_asks_max || late)
            ask_chunk(turn, hash, scene);
        else
            given_up.emplace_back(hash, scene.asks);
    }
    for (const auto& [hash, asks] : given_up)
        fail_tiles_of(turn, hash, FailureCode::machine,
                      "the broker does not send the scene, asked " + std::to_string(asks) +
                          " times");
}

std::vector<ContentHash> Session::scenes_at(Stage stage) const {
    std::vector<ContentHash> hashes;
    for (const auto& [hash, scene] : shelf_.scenes())
        if (scene.stage == stage)
            hashes.push_back(hash);
    return hashes;
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

const protocol::RenderTile* Session::find_at_allies(const protocol::RenderTile& order) const {
    for (const Session* ally : allies_)
        for (const auto& [ticket, tile] : ally->tiles_)
            if (tile.order.tile == order.tile && tile.order.attempt == order.attempt &&
                tile.order.job == order.job)
                return &tile.order;
    return nullptr;
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

/// Its own broker is lost. For others a tile goes on whose scene is here; they do not want a probe.
void Session::drop_what_no_ally_wants(Turn& turn) {
    if (!has_connected_ally())
        return drop_tiles(turn);
    for (auto at = tiles_.begin(); at != tiles_.end();) {
        const Tile& tile = at->second;
        const SceneOnShelf* scene = tile.holds_scene ? shelf_.find(tile.order.scene) : nullptr;
        const bool is_wanted =
            tile.order.probe_side == 0 && scene != nullptr && scene->stage != Stage::fetching;
        at = is_wanted ? std::next(at) : forget_tile(turn, at);
    }
}

void Session::fail_tile(Turn& turn, Tiles::iterator at, FailureCode code,
                        const std::string& reason) {
    const protocol::RenderTile& order = at->second.order;
    answer(turn, order,
           protocol::TileFailed{order.job, order.tile, order.attempt, code, sendable(reason)});
    forget_tile(turn, at);
}

/// To the broker that gave it and, but for a probe, to those that stand for it.
void Session::answer(Turn& turn, const protocol::RenderTile& order, protocol::Message message) {
    if (order.probe_side == 0 && !allies_.empty())
        answers_for_allies_.push_back(message);
    if (is_connected())
        send(turn, std::move(message));
}

void Session::list_tiles(std::vector<protocol::TileInFlight>& list) const {
    for (const auto& [ticket, tile] : tiles_)
        list.push_back({tile.order.job, tile.order.tile, tile.order.attempt, tile.rays,
                        tile.order.pass, rect_told(tile.order)});
}

std::size_t Session::tiles_in_hand() const {
    std::size_t count = tiles_.size();
    for (const Session* ally : allies_)
        count += ally->tiles_.size();
    return count;
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

} // namespace fraja::worker
