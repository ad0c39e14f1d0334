// Job: its tiles that are drawn twice, and what becomes of those of a worker that is not believed.
#include "broker/job.hpp"
#include "common/base/assert.hpp"

#include <algorithm>
#include <set>
#include <tuple>
#include <utility>

namespace fraja::broker {

using protocol::CellRect;

// ----------------------------------------------------------------------------------------- checks

void Job::count_check(const PeerId& peer) {
    ++in_flight_count_;
    party_->add(peer);
    ++workers_[peer];
}

void Job::uncount_check(const PeerId& peer) {
    --in_flight_count_;
    party_->remove(peer);
    if (const auto worker = workers_.find(peer); --worker->second == 0)
        workers_.erase(worker);
}

void Job::want_check(const Tile& tile, Checks::Answer first) {
    checks_.add(tile, std::move(first));
}

std::optional<std::pair<CheckId, Tile>> Job::assign_check(const WorkerId& worker,
                                                          const std::string& voter,
                                                          const Assignment& assignment,
                                                          const Checks::HasOthers& has_others) {
    const auto id = checks_.next_for(worker, voter, has_others);
    if (!id)
        return std::nullopt;
    checks_.assign(*id, assignment);
    count_check(assignment.peer);
    return std::pair(*id, checks_.find(*id)->tile);
}

bool Job::check_assigned_as(CheckId id, AttemptNumber attempt) const {
    const Checks::Check* check = checks_.find(id);
    return check && check->assignment && check->assignment->attempt == attempt;
}

void Job::take_back_check(CheckId id, const std::optional<WorkerId>& failed_on) {
    uncount_check(checks_.find(id)->assignment->peer);
    checks_.take_back(id, failed_on);
}

std::vector<WorkerId> Job::answer_check(CheckId id, Checks::Answer answer) {
    uncount_check(checks_.find(id)->assignment->peer);
    return checks_.answer(id, std::move(answer));
}

// ------------------------------------------------------------------------------------------ trust

bool Job::distrusts(const WorkerId& worker) const {
    return std::ranges::find(distrusted_, worker, &protocol::Distrusted::worker) !=
           distrusted_.end();
}

bool Job::has_tiles_of(const WorkerId& worker) const {
    return std::ranges::any_of(
        results_, [&](const Result& result) { return result.worker == worker && !result.is_void; });
}

Job::Voided Job::distrust(const protocol::Distrusted& worker) {
    FRAJA_ASSERT(!distrusts(worker.worker));
    distrusted_.push_back(worker);
    Voided voided;
    for (const Checks::Unwanted& check : checks_.forget(worker.worker)) {
        uncount_check(check.assignment.peer);
        voided.unwanted.push_back({check.tile, check.assignment});
    }
    for (Result& result : results_)
        if (result.worker == worker.worker && !result.is_void) {
            void_result(result);
            voided.tiles.push_back(result.tile);
        }
    undo(voided.tiles);
    if (!is_over(phase))
        for (const Tile& tile : voided.tiles)
            open_again(tile);
    return voided;
}

void Job::trust(const WorkerId& worker) {
    std::erase_if(distrusted_, [&](const auto& who) { return who.worker == worker; });
}

Job::Voided Job::void_unchecked() {
    const auto key = [](const Tile& tile) {
        const CellRect& c = tile.cells;
        return std::tuple(tile.pass, c.row, c.column, c.width, c.height);
    };
    std::set<decltype(key(Tile{}))> unchecked;
    for (const Tile& tile : checks_.tiles())
        unchecked.insert(key(tile));
    Voided voided;
    for (Result& result : results_)
        if (!result.is_void && unchecked.contains(key(result.tile))) {
            void_result(result);
            voided.tiles.push_back(result.tile);
        }
    undo(voided.tiles);
    voided.unwanted = drop_unfinished();
    checks_.clear();
    if (!is_over(phase))
        revive();
    return voided;
}

void Job::void_result(Result& result) {
    result.is_void = true;
    result.pixels.reset();
    results_pixels_ -= rect(result.tile).pixel_count();
}

/// But for cells that somebody else has drawn as well.
void Job::undo(const std::vector<Tile>& tiles) {
    if (tiles.empty())
        return;
    protocol::Bitmap drawn(static_cast<std::size_t>(grid_.count() * passes_));
    for (const Result& result : results_)
        if (!result.is_void)
            (void)grid_.all_of(result.tile.cells, [&](std::uint64_t cell) {
                drawn.set(bit(result.tile, cell));
                return true;
            });
    for (const Tile& tile : tiles)
        (void)grid_.all_of(tile.cells, [&](std::uint64_t cell) {
            const std::size_t at = bit(tile, cell);
            if (!done_.test(at) || drawn.test(at))
                return true;
            done_.reset(at);
            done_hash_ ^= Rng(at).next();
            --done_count_;
            if (tile.pass == 0) {
                ++first_pass_left_;
                costs_.undo(grid_.at(cell));
            }
            return true;
        });
}

/// What of it is not done, as large as it can be, before all else. Others may be at some of its
/// cells.
void Job::open_again(const Tile& tile) {
    std::uint64_t done = 0;
    (void)grid_.all_of(tile.cells, [&](std::uint64_t cell) {
        done += done_.test(bit(tile, cell));
        return true;
    });
    if (done == tile.cells.count() || (time_is_up_ && tile.pass > 0))
        return;
    if (done == 0) {
        overlapping_ = true;
        requeued_.push_front(
            open({.tile = tile, .work = costs_.work(tile.cells), .was_assigned = true}));
        return;
    }
    const auto [first, second] = halves(tile.cells);
    open_again({tile.pass, first});
    open_again({tile.pass, second});
}

} // namespace fraja::broker
