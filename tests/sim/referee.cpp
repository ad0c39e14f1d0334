#include "tests/sim/referee.hpp"

#include "broker/tile_plan.hpp"
#include "common/protocol/passes.hpp"

#include <algorithm>
#include <string>
#include <utility>
#include <variant>

namespace fraja::sim {

void Referee::begin(const broker::Contents* contents) {
    keeps_ = contents != nullptr;
    jobs_.clear();
    if (!contents)
        return;
    for (const broker::StoredJob& job : contents->jobs)
        for (const broker::StoredTile& tile : job.tiles)
            take(job.submission.job, tile.pass, tile.rect, tile.worker);
}

Referee::Watched& Referee::watched(const JobId& job) {
    const auto [at, is_new] = jobs_.try_emplace(job);
    if (is_new) {
        const protocol::SubmitJob& s = farm_.submitted.at(job).job;
        const std::uint32_t side =
            s.tile_side > 0 ? s.tile_side : broker::automatic_cell_side(s.settings);
        at->second.grid = protocol::CellGrid(s.settings.crop, side);
        at->second.done.resize(at->second.grid.count() * protocol::pass_count(s.settings));
    }
    return at->second;
}

std::uint64_t Referee::take(const JobId& job, std::uint32_t pass, const PixelRect& rect,
                            const WorkerId& worker) {
    Watched& w = watched(job);
    w.tiles.push_back({pass, rect, worker});
    return mark(w, job, w.tiles.back());
}

/// What it has drawn does not count.
void Referee::strike(const JobId& job, const WorkerId& worker) {
    Watched& w = watched(job);
    if (!w.struck.insert(worker).second)
        return;
    drop(w, job, [&](const Taken& tile) { return tile.worker == worker; });
}

void Referee::drop(Watched& w, const JobId& job, const std::function<bool(const Taken&)>& which) {
    std::erase_if(w.tiles, which);
    std::fill(w.done.begin(), w.done.end(), false);
    w.done_count = w.told_count = 0;
    for (const Taken& tile : w.tiles)
        (void)mark(w, job, tile);
}

/// What was not checked before another broker came to lead.
void Referee::drop(const JobId& job, const broker::PutDistrusted::Tile& which) {
    Watched& w = watched(job);
    drop(w, job, [&](const Taken& tile) {
        const auto cells = w.grid.cells(tile.rect);
        return cells && Extent{tile.rect.width, tile.rect.height} == which.size &&
               tile.pass * w.grid.count() + w.grid.index(*cells) ==
                   static_cast<std::uint32_t>(which.tile);
    });
}

std::uint64_t Referee::mark(Watched& w, const JobId& job, const Taken& tile) {
    const auto& [pass, rect, worker] = tile;
    const auto cells = w.grid.cells(rect);
    if (!cells) {
        violation(job, "has a tile that is not of its cells");
        return 1;
    }
    std::uint64_t fresh = 0;
    (void)w.grid.all_of(*cells, [&](std::uint64_t cell) {
        const std::size_t bit = pass * w.grid.count() + cell;
        fresh += !w.done[bit];
        w.done[bit] = true;
        return true;
    });
    w.done_count += fresh;
    return fresh;
}

bool Referee::is_done(const JobId& job, std::uint32_t pass, const PixelRect& rect) {
    const Watched& w = watched(job);
    const auto cells = w.grid.cells(rect);
    return cells && w.grid.all_of(*cells, [&](std::uint64_t cell) {
        return w.done[pass * w.grid.count() + cell];
    });
}

void Referee::look_at(const broker::Action& action) {
    if (const auto* send = std::get_if<broker::Send>(&action)) {
        look_at(send->message);
    } else if (const auto* publish = std::get_if<broker::Publish>(&action)) {
        const auto* tile = std::get_if<protocol::TileDone>(&publish->message);
        // That a worker is distrusted may not have been told, where nobody listened.
        if (tile && !keeps_ && take(tile->job, tile->pass, tile->rect, tile->worker) == 0 &&
            !has_liars(farm_.scenario))
            violation(tile->job, "has a tile accepted that brings nothing");
        look_at(publish->message);
    } else if (const auto* persist = std::get_if<broker::Persist>(&action)) {
        const auto* voided = std::get_if<broker::PutDistrusted>(&persist->write);
        if (voided && voided->worker.worker != WorkerId{})
            strike(voided->job, voided->worker.worker);
        else if (voided)
            for (const auto& tile : voided->tiles)
                drop(voided->job, tile);
        if (const auto* trusted = std::get_if<broker::PutTrusted>(&persist->write))
            watched(trusted->job).struck.erase(trusted->worker);
        if (const auto* gone = std::get_if<broker::ForgetJob>(&persist->write))
            jobs_.erase(gone->job); // it may come back from another broker
        const auto* put = std::get_if<broker::PutTile>(&persist->write);
        if (put && take(put->tile->job, put->tile->pass, put->tile->rect, put->tile->worker) == 0)
            violation(put->tile->job, "has a tile accepted that brings nothing");
    }
}

void Referee::look_at(const protocol::Message& message) {
    if (const auto* order = std::get_if<protocol::RenderTile>(&message))
        look_at(*order);
    else if (const auto* state = std::get_if<protocol::JobState>(&message))
        look_at(*state);
    else if (const auto* done = std::get_if<protocol::RepairDone>(&message))
        look_at(done->state);
}

void Referee::look_at(const protocol::RenderTile& order) {
    const bool is_checked = farm_.submitted.at(order.job).job.wishes.verify > 0;
    if (order.probe_side == 0 && !is_checked && is_done(order.job, order.pass, order.rect))
        violation(order.job, "has a tile handed out that was done before");
}

void Referee::look_at(const protocol::JobState& state) {
    Watched& w = watched(state.job);
    std::erase_if(w.struck, [&](const WorkerId& worker) { // it may be trusted again
        return std::ranges::find(state.distrusted, worker, &protocol::Distrusted::worker) ==
               state.distrusted.end();
    });
    for (const protocol::Distrusted& who : state.distrusted)
        strike(state.job, who.worker);
    if (std::exchange(w.epoch, state.epoch) != state.epoch && state.verify > 0 && !keeps_)
        drop(w, state.job, [](const Taken&) { return true; }); // which of them is told to nobody
    if (std::exchange(w.number, state.number) != state.number && !keeps_)
        drop(w, state.job, [](const Taken&) { return true; }); // given up, perhaps, and come back
    // Somebody may have been distrusted and, as the job was done elsewhere, trusted again, of which
    // this one has heard neither: what he had drawn comes once more, from the others.
    if (std::exchange(w.revision, state.revision) != state.revision && state.verify > 0 &&
        !keeps_ && state.done_count < std::max<std::uint64_t>(w.told_count, w.done_count))
        drop(w, state.job, [](const Taken&) { return true; });
    if (state.done_count < w.told_count)
        violation(state.job, "has fewer cells than before");
    w.told_count = state.done_count;
    if (keeps_ ? state.done_count != w.done_count : state.done_count < w.done_count)
        violation(state.job, "says " + std::to_string(state.done_count) + " cells are done, not " +
                                 std::to_string(w.done_count));
    if (state.phase != protocol::JobPhase::done)
        return;
    const std::uint64_t wanted =
        state.settings.limited_in_time() ? w.grid.count() : state.cell_count;
    if (state.done_count < wanted ||
        (keeps_ &&
         !std::all_of(w.done.begin(), w.done.begin() + static_cast<std::ptrdiff_t>(w.grid.count()),
                      [](bool done) { return done; })))
        violation(state.job, "is done without all its cells");
}

void Referee::violation(const JobId& job, const std::string& what) {
    farm_.violation("job " + std::to_string(farm_.submitted.at(job).plan) + " " + what);
}

} // namespace fraja::sim
