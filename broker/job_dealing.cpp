// Job: which tile is handed out next, to whom, and how large.
#include "broker/job.hpp"
#include "common/base/assert.hpp"
#include "common/protocol/limits.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

namespace fraja::broker {

using protocol::CellRect;

namespace {

// Tiles that may be open one above the other: the whole, its parts, their parts.
constexpr int overbooked_max = 3;

// Scouts are few: so they may be that part of the work that they should be.
constexpr double scout_part = 1.0 / 16;

} // namespace

// ------------------------------------------------------------------------------------ handing out

bool Job::has_pending() const {
    return !requeued_.empty() || fresh_ < fresh_end_ || !pending_.empty();
}

OpenTileId Job::next_fixed() {
    while (fresh_ < fresh_end_) {
        const auto pass = static_cast<std::uint32_t>(fresh_ / grid_.count());
        const Tile tile{pass, grid_.at(order_[fresh_++ % grid_.count()])};
        if (!all_cells_done(tile) && !adopted_.contains(bit(tile, grid_.index(tile.cells))))
            return open({.tile = tile, .work = costs_.work(tile.cells)});
    }
    return OpenTileId::none;
}

OpenTileId Job::take_pending(const Bidder& bidder) {
    const auto fits = [&](OpenTileId id) {
        const OpenTile& tile = open_.at(id);
        const auto whole = open_.find(tile.whole);
        if (whole != open_.end() && whole->second.assignment &&
            whole->second.assignment->peer == bidder.peer && whole->second.tile == tile.tile)
            return false; // it is at it already
        return std::ranges::find(tile.failed_on, bidder.worker) == tile.failed_on.end() ||
               !bidder.has_others(tile.failed_on);
    };
    if (const auto at = std::ranges::find_if(requeued_, fits); at != requeued_.end()) {
        const OpenTileId id = *at;
        requeued_.erase(at);
        return id;
    }
    if (fresh_ < fresh_end_)
        return next_fixed();
    if (bidder.scout_work && !dealt_out_)
        if (const OpenTileId scout = next_scout(*bidder.scout_work); scout != OpenTileId::none)
            return scout;
    auto queue = pending_.find(bidder.worker);
    if (queue == pending_.end())
        queue = pending_.find(std::nullopt);
    const bool steals = queue == pending_.end() && stealing_;
    if (steals)
        queue = std::ranges::max_element(pending_, {},
                                         [](const auto& entry) { return entry.second.size(); });
    if (queue == pending_.end())
        return OpenTileId::none;
    const OpenTileId id = steals ? queue->second.rbegin()->id : queue->second.begin()->id;
    erase_pending(id, open_.at(id));
    if (!dealt_out_)
        join_blocks(id, std::min(bidder.work_wanted, bidder.joined_work_max));
    return id;
}

/// A spot of a block that is fresh, with as much around it as makes it so much work, while all
/// scouts stay a small part of the picture: what a tile costs beside its pixels should not be taken
/// for theirs. The rest of the block stays pending. None while spots are thought to be far less
/// work than that: the picture is done soon.
OpenTileId Job::next_scout(double work_wanted) {
    if (scouts_.empty() || costs_.done() + costs_.left() <
                               scout_part * work_wanted * static_cast<double>(costs_.spot_count()))
        return OpenTileId::none;
    const auto is_small = [&](const CellRect& cells) {
        return static_cast<double>(grid_.pixels(cells).pixel_count()) <= scout_pixels_max_;
    };
    while (!scouts_.empty()) {
        const CellRect scout = scouts_.front();
        scouts_.pop_front();
        const OpenTileId id = fresh_blocks_[costs_.block_of(scout)];
        if (id == OpenTileId::none)
            continue;
        CellRect tile = open_.at(id).tile.cells;
        close(id);
        for (;;) {
            const auto [first, second] = halves(tile);
            const bool is_in_first = contains(first, scout);
            if (tile == scout || !(is_in_first || contains(second, scout)))
                break; // the middle of a block at the border goes through it
            const CellRect half = is_in_first ? first : second;
            if (is_small(tile) && costs_.work(half) < work_wanted)
                break;
            tile = half;
            push_pending(open({.tile = {0, is_in_first ? second : first}}));
        }
        return open({.tile = {0, tile}, .work = costs_.work(tile)});
    }
    return OpenTileId::none;
}

/// Of a tile that is too much the first part that is not; the others become pending where it was.
OpenTileId Job::cut(OpenTileId id, double work_wanted) {
    const bool is_urgent = open_.at(id).was_assigned || open_.at(id).whole != OpenTileId::none;
    for (;;) {
        OpenTile& tile = open_.at(id);
        tile.work = costs_.work(tile.tile.cells);
        if (!can_cut(tile.tile) || costs_.risk(tile.tile.cells) <= work_wanted)
            return id;
        overlapping_ = overlapping_ || tile.was_assigned; // its worker may still answer
        const auto [first, second] = halves(tile.tile.cells);
        // One half may be done: by a part, when the whole was given out again, or by a late answer.
        if (const bool first_is_done = all_cells_done({tile.tile.pass, first});
            first_is_done || all_cells_done({tile.tile.pass, second})) {
            tile.tile.cells = first_is_done ? second : first;
            continue;
        }
        OpenTile rest = tile;
        rest.tile.cells = second;
        tile.tile.cells = first;
        if (const auto whole = open_.find(tile.whole); whole != open_.end())
            ++whole->second.parts;
        const OpenTileId rest_id = open(std::move(rest));
        if (is_urgent)
            requeued_.push_front(rest_id);
        else
            push_pending(rest_id);
    }
}

/// A fresh block is put together with those beside it, square after square of twice the side, as
/// long as all of that is fresh: tiles should not be small where the work is.
void Job::join_blocks(OpenTileId id, double work_max) {
    OpenTile& tile = open_.at(id);
    if (submission_.order != protocol::TileOrder::automatic || !is_fresh_block(tile))
        return;
    const std::size_t block = costs_.block_of(tile.tile.cells);
    const std::uint32_t side_max =
        protocol::tile_side_max / (costs_.block_side() * grid_.side()); // in blocks
    for (std::uint32_t side = 2; side <= side_max; side *= 2) {
        const CellRect wider = costs_.blocks(block, side);
        if (costs_.risk(wider) > work_max)
            return;
        const std::vector<std::size_t> blocks = costs_.blocks_in(wider);
        if (!std::ranges::all_of(blocks, [&](std::size_t b) {
                return fresh_blocks_[b] != OpenTileId::none ||
                       contains(tile.tile.cells, costs_.blocks(b, 1));
            }))
            return;
        for (const std::size_t b : blocks)
            if (const OpenTileId other = fresh_blocks_[b]; other != OpenTileId::none)
                close(other);
        leave(id, tile);
        tile.tile.cells = wider;
        enter(id, tile);
    }
}

std::optional<Job::Handed> Job::assign_next(const Bidder& bidder) {
    if (results_.size() >= 2 * ranked_at_ + 8)
        rank_anew();
    OpenTileId id{};
    for (;;) {
        id = take_pending(bidder);
        if (id == OpenTileId::none)
            return std::nullopt;
        if (!dealt_out_ || stealing_)
            id = cut(id, bidder.work_wanted);
        if (!overlapping_ || !all_cells_done(open_.at(id).tile))
            break;
        close(id); // a late answer has brought it
    }
    OpenTile& tile = open_.at(id);
    assign(tile, {bidder.peer, bidder.attempt});
    return Handed{id, tile.tile, tile.work};
}

bool Job::assigned_as(OpenTileId id, AttemptNumber attempt) const {
    const auto found = open_.find(id);
    return found != open_.end() && found->second.assignment &&
           found->second.assignment->attempt == attempt;
}

// ---------------------------------------------------------------------------------- dealing it out

void Job::deal_out(const std::vector<Share>& shares, bool by_work, bool stealing) {
    FRAJA_ASSERT(!dealt_out_ && passes_ == 1 && !shares.empty());
    dealt_out_ = true;
    stealing_ = stealing;
    drop_pending();
    fresh_ = fresh_end_;
    share_out(grid_.all(), shares, by_work);
}

/// To one half of the workers one side of the cells, to the other half the other.
void Job::share_out(const CellRect& cells, std::span<const Share> shares, bool by_work) {
    if (cells.count() == 0)
        return;
    if (shares.size() == 1)
        return open_by_blocks(cells, shares.front().worker);
    const auto sum = [](std::span<const Share> some) {
        return std::accumulate(some.begin(), some.end(), 0.0,
                               [](double s, const Share& share) { return s + share.share; });
    };
    const auto first_shares = shares.first(shares.size() / 2);
    const double part = sum(first_shares) / sum(shares);

    const bool across = cells.width >= cells.height; // columns are dealt out
    const std::uint32_t length = across ? cells.width : cells.height;
    std::vector<double> weights(length); // of each column or row
    (void)grid_.all_of(cells, [&](std::uint64_t cell) {
        const CellRect at = grid_.at(cell);
        weights[across ? at.column - cells.column : at.row - cells.row] +=
            by_work ? costs_.work(at) : static_cast<double>(grid_.pixels(at).pixel_count());
        return true;
    });
    const double wanted = part * std::accumulate(weights.begin(), weights.end(), 0.0);
    std::uint32_t first = 0;
    for (double weight = 0; first < length && weight + weights[first] / 2 <= wanted; ++first)
        weight += weights[first];

    CellRect one = cells, other = cells;
    (across ? one.width : one.height) = first;
    (across ? other.column : other.row) += first;
    (across ? other.width : other.height) -= first;
    share_out(one, first_shares, by_work);
    share_out(other, shares.subspan(first_shares.size()), by_work);
}

void Job::release_share(const WorkerId& worker) {
    const auto queue = pending_.find(worker);
    if (queue == pending_.end())
        return;
    const std::set<Place> places = std::move(queue->second);
    pending_.erase(queue);
    for (const Place& place : places) {
        open_.at(place.id).owner.reset();
        push_pending(place.id);
    }
}

// ------------------------------------------------------------------------------------ overbooking

bool Job::can_overbook(OpenTileId id) const {
    auto tile = open_.find(id);
    if (tile == open_.end() || !tile->second.assignment || tile->second.parts > 0)
        return false;
    int above = 1;
    while ((tile = open_.find(tile->second.whole)) != open_.end())
        ++above;
    return above < overbooked_max;
}

void Job::overbook(OpenTileId id, std::uint32_t parts) {
    FRAJA_ASSERT(can_overbook(id) && parts > 0);
    overlapping_ = true;
    OpenTile& whole = open_.at(id);
    std::deque<CellRect> pieces{whole.tile.cells}; // the largest first
    while (pieces.size() < parts && can_cut({whole.tile.pass, pieces.front()})) {
        const auto [first, second] = halves(pieces.front());
        pieces.pop_front();
        pieces.push_back(first);
        pieces.push_back(second);
    }
    std::erase_if(pieces, [&](const CellRect& cells) {
        return all_cells_done({whole.tile.pass, cells}); // by parts of an earlier time
    });
    whole.covered = true;
    whole.parts = static_cast<std::uint32_t>(pieces.size());
    for (const CellRect& cells : pieces)
        requeued_.push_front(open({.tile = {whole.tile.pass, cells},
                                   .work = costs_.work(cells),
                                   .failed_on = whole.failed_on,
                                   .whole = id}));
}

} // namespace fraja::broker
