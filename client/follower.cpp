#include "client/follower.hpp"

#include "common/protocol/limits.hpp"
#include "common/protocol/passes.hpp"
#include "common/protocol/pixels.hpp"
#include "common/protocol/topics.hpp"

#include <algorithm>
#include <tuple>
#include <utility>

namespace fraja::client {
namespace {

using namespace std::chrono_literals;

constexpr Duration barrier_max = 1s; // then another nonce is tried
constexpr Duration repair_max = 2s;  // without a sign of an answer
constexpr Duration silence_max = 2s;
constexpr Duration fruitless_pause = 250ms; // after a repair that should have brought a tile

/// That nothing is left though cells are missing: somebody else's question was answered; or, in the
/// end, the broker cannot read what it has stored, or believes others.
constexpr std::uint32_t odd_answers_max = 8;

/// Who is asked has by then heard of a later epoch, unless nobody has it any more: of several
/// brokers the one that had begun it may be gone.
constexpr Duration epoch_patience = 10s;

constexpr Duration elapsed_max = 24h * 36'500; // more can hardly be true

constexpr std::uint64_t repair_bytes = std::uint64_t{16} << 20; // in one answer, about
constexpr std::uint64_t repair_tiles_max = 256;

Nonce make_nonce(Rng& rng) {
    Nonce nonce;
    for (std::size_t i = 0; i < nonce.bytes.size(); i += 8) {
        const std::uint64_t bits = rng.next();
        for (std::size_t b = 0; b < 8; ++b)
            nonce.bytes[i + b] = static_cast<std::uint8_t>(bits >> (8 * b));
    }
    return nonce;
}

/// Whether `next` was said after `last`. The session and the stream overtake each other.
bool is_newer(const protocol::JobState& next, const protocol::JobState& last) {
    if (next.epoch != last.epoch)
        return next.epoch > last.epoch;
    if (next.revision != last.revision) // other brokers of the epoch may be behind
        return next.revision > last.revision;
    if (next.distrusted.size() != last.distrusted.size()) // it only grows; what is done need not
        return next.distrusted.size() > last.distrusted.size();
    if (is_over(last.phase)) // for ever, or until it is tried again: then its time goes on
        return last.phase != protocol::JobPhase::done && next.elapsed > last.elapsed;
    if (next.phase == protocol::JobPhase::waiting_for_scene) // as no job does again
        return next.phase == last.phase;
    if (!is_over(next.phase) && next.done_count != last.done_count)
        return next.done_count > last.done_count;
    return next.elapsed >= last.elapsed;
}

/// As a job that is done has; but when its time is up, it is done with what there is.
bool has_all_tiles(const protocol::JobState& state) {
    return state.phase == protocol::JobPhase::done && !state.settings.limited_in_time();
}

protocol::CellGrid grid_of(const protocol::JobState& state) {
    return state.cell_side > 0 ? protocol::CellGrid(state.settings.crop, state.cell_side)
                               : protocol::CellGrid();
}

std::uint32_t tiles_per_repair(const protocol::JobState& state) {
    const std::uint64_t pixels = state.settings.crop.pixel_count();
    const std::uint64_t tile_bytes =
        std::max<std::uint64_t>(1, pixels / std::max(state.cell_count, 1u)) *
        state.settings.pixel_bytes();
    return static_cast<std::uint32_t>(
        std::clamp<std::uint64_t>(repair_bytes / tile_bytes, 1, repair_tiles_max));
}

} // namespace

Follower::Follower(protocol::JobState state, Rng rng)
    : state_(std::move(state)), grid_(grid_of(state_)), rng_(rng), have_(state_.cell_count) {
    FRAJA_ASSERT(is_sound(state_));
}

bool Follower::is_sound(const protocol::JobState& state) {
    const bool is_cut = state.cell_side > 0;
    return state.cell_count <= protocol::cells_per_job_max && protocol::validate(state.settings) &&
           state.cell_side <= protocol::tile_side_max &&
           state.cell_count ==
               (is_cut ? grid_of(state).count() * protocol::pass_count(state.settings) : 0) &&
           state.done_count <= state.cell_count &&
           state.distrusted.size() <= protocol::distrusted_max &&
           (state.phase != protocol::JobPhase::done || is_cut) &&
           state.elapsed >= Duration::zero() && state.elapsed <= elapsed_max;
}

void Follower::start(Instant now, std::vector<Action>& actions) {
    barrier_pending_ = false;
    repair_pending_ = false;
    forgotten_ = false;
    repair_wanted_ = repair_ends_ = barrier_ends_ = Instant::never();
    look_whether_complete();
    if (complete_)
        return;
    if (is_over(state_.phase)) { // nothing more will be published: all there is can be asked for
        repair_wanted_ = now;
        return ask_if_due(now, actions);
    }
    actions.push_back(Subscribe{protocol::job_topic(state_.job)});
    raise_barrier(now, actions);
}

void Follower::step(Instant now, const Event& event, std::vector<Action>& actions) {
    using namespace protocol;
    if (complete_ || forgotten_)
        return;
    const auto* session = std::get_if<FromBroker>(&event);
    const auto* stream = std::get_if<FromStream>(&event);
    if (session || stream) {
        const Message& message = session ? session->message : stream->message;
        if (const auto* tile = std::get_if<TileDone>(&message)) {
            if (session && repair_pending_)
                repair_ends_ = now + repair_max;
            take(now, *tile, actions);
        } else if (const auto* state = std::get_if<JobState>(&message)) {
            take(now, *state, stream != nullptr, actions);
        } else if (const auto* done = std::get_if<RepairDone>(&message)) {
            take(now, *done, actions);
        } else if (const auto* barrier = std::get_if<Barrier>(&message)) {
            take(now, *barrier, actions);
        } else if (const auto* refused = std::get_if<Refused>(&message)) {
            forgotten_ =
                session && refused->code == RefusalCode::no_such_job && refused->job == state_.job;
        }
    } else if (std::holds_alternative<Tick>(event)) {
        tick(now, actions);
    }
    look_whether_complete();
    if (complete_ || forgotten_)
        return;
    ask_if_due(now, actions);
    FRAJA_ASSERT(next_deadline() < Instant::never()); // whatever is lost, we ask again
}

Instant Follower::next_deadline() const {
    if (complete_ || forgotten_)
        return Instant::never();
    return std::min({barrier_ends_, repair_pending_ ? repair_ends_ : repair_wanted_});
}

void Follower::take(Instant now, const protocol::TileDone& tile, std::vector<Action>& actions) {
    const auto cells_of_tile = cells(tile);
    if (!cells_of_tile) {
        ++counts_.rubbish;
        return;
    }
    if (!repair_pending_ && !barrier_pending_)
        repair_wanted_ = now + silence_max;
    if (distrusts(tile.worker) || is_of_another_epoch(tile)) {
        ++counts_.distrusted;
        return;
    }
    const std::vector<protocol::CellRect> fresh = take_fresh(*cells_of_tile, tile.pass);
    if (fresh.empty()) {
        ++counts_.duplicates;
        return;
    }
    repair_brought_any_ = true;
    note_who_drew(fresh, tile.worker);
    if (fresh.front() == *cells_of_tile) {
        actions.push_back(News(TileArrived{tile, state_.cell_count}));
        return;
    }
    // Some of it is here already: it was given out in parts as well.
    for (const protocol::CellRect& part : fresh)
        actions.push_back(News(TileArrived{part_of(tile, part), state_.cell_count}));
}

/// Marks the cells and returns what of them was not here, as rectangles.
std::vector<protocol::CellRect> Follower::take_fresh(const protocol::CellRect& cells,
                                                     std::uint32_t pass) {
    std::vector<protocol::CellRect> fresh;
    for (std::uint32_t row = cells.row; row < cells.row + cells.height; ++row)
        for (std::uint32_t column = cells.column; column < cells.column + cells.width; ++column) {
            const auto bit =
                static_cast<std::size_t>(pass * grid_.count() + grid_.index(column, row));
            if (have_.test(bit))
                continue;
            have_.set(bit);
            ++have_count_;
            if (!fresh.empty() && fresh.back().row == row &&
                fresh.back().column + fresh.back().width == column)
                ++fresh.back().width;
            else
                fresh.push_back({column, row, 1, 1});
        }
    // Runs of cells that lie one below the other are one rectangle.
    std::vector<protocol::CellRect> rects;
    for (const protocol::CellRect& run : fresh) {
        const auto above = std::ranges::find_if(rects, [&](const protocol::CellRect& r) {
            return r.column == run.column && r.width == run.width && r.row + r.height == run.row;
        });
        if (above != rects.end())
            ++above->height;
        else
            rects.push_back(run);
    }
    return rects;
}

void Follower::note_who_drew(const std::vector<protocol::CellRect>& cells, const WorkerId& worker) {
    if (state_.settings.limited_in_time())
        return;
    const auto known = std::ranges::find(workers_, worker);
    const auto index = static_cast<std::uint32_t>(known - workers_.begin());
    if (known == workers_.end())
        workers_.push_back(worker);
    for (const protocol::CellRect& part : cells)
        drawn_.push_back({part, index});
}

/// The newest word on that counts: a broker that takes over may not have heard it yet.
bool Follower::distrusts(const WorkerId& worker) const {
    return !state_.settings.limited_in_time() &&
           std::ranges::find(state_.distrusted, worker, &protocol::Distrusted::worker) !=
               state_.distrusted.end();
}

/// It was sent before the broker heard of the epoch that is known here, and came by another way
/// than the word of that: by now it may have been dropped unchecked. Of a later one, it belongs to
/// what is to be told of that.
bool Follower::is_of_another_epoch(const protocol::TileDone& tile) const {
    return state_.verify > 0 && tile.epoch != 0 && tile.epoch != state_.epoch;
}

/// What came of workers that are distrusted now is missing again.
void Follower::withdraw(Instant now, std::vector<Action>& actions) {
    if (state_.distrusted.empty() || state_.settings.limited_in_time())
        return;
    for (const protocol::Distrusted& who : state_.distrusted) {
        const auto known = std::ranges::find(workers_, who.worker);
        if (known == workers_.end())
            continue;
        const auto index = static_cast<std::uint32_t>(known - workers_.begin());
        TilesWithdrawn withdrawn{{}, who.worker_name};
        std::erase_if(drawn_, [&](const Drawn& drawn) {
            if (drawn.worker != index)
                return false;
            withdrawn.rects.push_back(grid_.pixels(drawn.cells));
            (void)grid_.all_of(drawn.cells, [&](std::uint64_t cell) {
                have_.reset(static_cast<std::size_t>(cell));
                --have_count_;
                return true;
            });
            return true;
        });
        if (withdrawn.rects.empty())
            continue;
        actions.push_back(News(std::move(withdrawn)));
        if (!repair_pending_ && !barrier_pending_)
            repair_wanted_ = now + silence_max;
    }
}

void Follower::withdraw_all(std::vector<Action>& actions) {
    TilesWithdrawn withdrawn;
    for (const Drawn& drawn : drawn_)
        withdrawn.rects.push_back(grid_.pixels(drawn.cells));
    drawn_.clear();
    have_ = protocol::Bitmap(state_.cell_count);
    have_count_ = 0;
    if (!withdrawn.rects.empty())
        actions.push_back(News(std::move(withdrawn)));
}

/// What it cost is told of the part at its place, by its pixels.
protocol::TileDone Follower::part_of(const protocol::TileDone& tile,
                                     const protocol::CellRect& cells) const {
    protocol::TileDone part = tile;
    part.rect = grid_.pixels(cells);
    part.tile =
        TileIndex(static_cast<std::uint32_t>(tile.pass * grid_.count() + grid_.index(cells)));
    protocol::PixelPlanes whole(tile.rect, state_.settings.pixel_bytes());
    whole.place(tile.rect, tile.blobs);
    part.blobs = whole.blobs(part.rect);
    const double share =
        static_cast<double>(part.rect.pixel_count()) / static_cast<double>(tile.rect.pixel_count());
    std::apply(
        [&](const auto&... field) {
            ((part.rays.*field.member =
                  static_cast<std::uint64_t>(share * static_cast<double>(tile.rays.*field.member))),
             ...);
        },
        protocol::Rays::fields());
    part.elapsed = from_seconds(share * seconds(tile.elapsed));
    return part;
}

std::optional<protocol::CellRect> Follower::cells(const protocol::TileDone& tile) const {
    if (tile.job != state_.job || tile.pass >= protocol::pass_count(state_.settings))
        return std::nullopt;
    const auto found = grid_.cells(tile.rect);
    if (!found ||
        tile.pass * grid_.count() + grid_.index(*found) != static_cast<std::uint32_t>(tile.tile))
        return std::nullopt;
    return byte_count(tile.blobs) == state_.settings.pixel_bytes() * tile.rect.pixel_count()
               ? found
               : std::nullopt;
}

void Follower::take(Instant now, const protocol::JobState& state, bool digest,
                    std::vector<Action>& actions) {
    if (!adopt(now, state, !digest, actions))
        return;
    if (is_over(state_.phase))
        lower_barrier(actions); // nothing more will be published
    if (repair_pending_ || barrier_pending_)
        return;
    const bool dropped = digest && state.done_count > have_count_;
    repair_wanted_ = dropped || is_over(state_.phase) ? now : now + silence_max;
}

void Follower::take(Instant now, const protocol::RepairDone& done, std::vector<Action>& actions) {
    if (!adopt(now, done.state, true, actions))
        return;
    if (is_over(state_.phase))
        lower_barrier(actions);
    if (done.state.epoch < state_.epoch)
        return;             // what another broker had told an earlier follower
    if (!repair_pending_) { // the answer to a request that was given up or repeated
        if (is_over(state_.phase))
            repair_wanted_ = now;
        return;
    }
    repair_pending_ = false;
    repair_ends_ = Instant::never();
    const bool all_told = done.remaining_count == 0;
    caught_up_ = caught_up_ || all_told;
    if (is_over(done.state.phase) != is_over(state_.phase)) // before the end, or a new beginning
        repair_wanted_ = repair_brought_any_ ? now : now + fruitless_pause; // or by one behind
    else if (all_told && is_over(state_.phase) && !has_all_tiles(state_) &&
             (has_as_many_as(state_) || ++odd_answers_ == odd_answers_max))
        complete_ = true; // failed, cancelled, out of time: there is no more
    else if (all_told && is_over(done.state.phase) && !repair_brought_any_ &&
             done.state.distrusted != state_.distrusted && ++odd_answers_ >= odd_answers_max) {
        // Both have come to an end, and whoever told of one that is not believed here may be gone.
        odd_answers_ = 0;
        show(now, done.state, actions);
        repair_wanted_ = now;
    } else if (!all_told || is_over(state_.phase))
        repair_wanted_ = repair_brought_any_ ? now : now + fruitless_pause;
    else
        repair_wanted_ = now + silence_max;
}

void Follower::take(Instant now, const protocol::Barrier& barrier, std::vector<Action>& actions) {
    if (!barrier_pending_ || barrier.nonce != nonce_)
        return;
    lower_barrier(actions);
    // A repair that was asked before cannot know what was published before the subscription stood.
    repair_pending_ = false;
    repair_wanted_ = now;
}

/// Whoever is asked is in an epoch before that which was heard of, and stays there.
bool Follower::is_lost_epoch(Instant now, const protocol::JobState& asked) {
    if (asked.epoch >= state_.epoch)
        behind_since_ = Instant::never();
    else
        behind_since_ = std::min(behind_since_, now);
    return asked.epoch < state_.epoch && now - behind_since_ >= epoch_patience;
}

void Follower::show(Instant now, const protocol::JobState& state, std::vector<Action>& actions) {
    state_ = state;
    withdraw(now, actions);
    actions.push_back(News(StateChanged{state_}));
}

/// Whether the state is about this job and can be. Shows it when it is newer.
bool Follower::adopt(Instant now, const protocol::JobState& state, bool asked,
                     std::vector<Action>& actions) {
    const bool same_cells =
        state.cell_side == state_.cell_side || state_.cell_side == 0; // it was not cut before
    if (state.job != state_.job || !is_sound(state) || state.settings != state_.settings ||
        !same_cells) {
        ++counts_.rubbish;
        return false;
    }
    if (!(asked && is_lost_epoch(now, state)) && !is_newer(state, state_))
        return true;
    if (state_.cell_side == 0) {
        grid_ = grid_of(state);
        have_ = protocol::Bitmap(state.cell_count);
    }
    if (state.epoch != state_.epoch && have_count_ > 0) {
        if (state.verify > 0) // of what the last broker had not kept nobody knows who is right
            withdraw_all(actions);
        else
            has_of_earlier_epochs_ = true;
    }
    show(now, state, actions);
    return true;
}

void Follower::tick(Instant now, std::vector<Action>& actions) {
    if (barrier_pending_ && now >= barrier_ends_) {
        ++counts_.barriers_lost;
        lower_barrier(actions);
        raise_barrier(now, actions);
        if (!repair_pending_)
            repair_wanted_ = now; // whoever cannot reach the stream gets its tiles all the same
    }
    if (repair_pending_ && now >= repair_ends_) {
        repair_pending_ = false;
        repair_wanted_ = now;
    }
}

void Follower::raise_barrier(Instant now, std::vector<Action>& actions) {
    nonce_ = make_nonce(rng_);
    barrier_pending_ = true;
    barrier_ends_ = now + barrier_max;
    actions.push_back(Subscribe{protocol::barrier_topic(nonce_)});
}

void Follower::lower_barrier(std::vector<Action>& actions) {
    if (barrier_pending_)
        actions.push_back(Unsubscribe{protocol::barrier_topic(nonce_)});
    barrier_pending_ = false;
    barrier_ends_ = Instant::never();
}

void Follower::ask_if_due(Instant now, std::vector<Action>& actions) {
    if (repair_pending_ || now < repair_wanted_)
        return;
    repair_pending_ = true;
    repair_brought_any_ = false;
    repair_ends_ = now + repair_max;
    repair_wanted_ = Instant::never();
    ++counts_.repairs;
    actions.push_back(Send{protocol::Repair{state_.job, tiles_per_repair(state_), have_.bytes()}});
}

void Follower::look_whether_complete() {
    if (!is_over(state_.phase))
        return;
    // What a broker had not stored when it died is here, and the next one does not have it: then
    // numbers tell nothing, and a repair must be answered.
    if (has_all_tiles(state_) ? have_count_ >= state_.cell_count
                              : has_as_many_as(state_) && !has_of_earlier_epochs_)
        complete_ = true;
}

/// Of several brokers another one may have had other cells of the later passes: whatever their
/// number, the first pass of one that is done must be here.
bool Follower::has_as_many_as(const protocol::JobState& state) const {
    if (have_count_ < state.done_count)
        return false;
    if (state.phase != protocol::JobPhase::done)
        return true;
    return grid_.all_of(grid_.all(), [&](std::uint64_t cell) {
        return have_.test(static_cast<std::size_t>(cell));
    });
}

} // namespace fraja::client
