#include "broker/job.hpp"

#include "broker/tile_plan.hpp"
#include "common/base/assert.hpp"
#include "common/protocol/passes.hpp"

#include <algorithm>
#include <utility>

namespace fraja::broker {

using protocol::CellRect;

namespace {

constexpr std::uint32_t forgiven_max =
    10; // times: what stops its process again and again is no accident
constexpr std::uint64_t tile_overhead_bytes = 300; // a result's own fields and allocations

std::uint32_t side_of(const protocol::SubmitJob& s) {
    return s.tile_side > 0 ? s.tile_side : automatic_cell_side(s.settings);
}

} // namespace

Job::Job(protocol::SubmitJob submission, std::uint32_t number, PeerId client)
    : priority(submission.priority), submission_(std::move(submission)), number_(number),
      client_(std::move(client)), party_(std::make_shared<Party>(number, submission_.wishes)),
      grid_(submission_.settings.crop, side_of(submission_)),
      costs_(grid_, camera_rays_min(submission_.settings)),
      passes_(protocol::pass_count(submission_.settings)),
      done_(static_cast<std::size_t>(grid_.count() * passes_)), first_pass_left_(grid_.count()) {
    fresh_blocks_.resize(std::size_t{costs_.block_columns()} * costs_.block_rows());
    open_in_blocks_.resize(fresh_blocks_.size());
    plan();
}

void Job::set_passes(std::uint32_t passes) {
    FRAJA_ASSERT(passes > 0 && passes <= pass_count(submission_.settings) && fresh_ == 0);
    passes_ = passes;
    if (is_fixed())
        fresh_end_ = grid_.count() * passes;
}

void Job::set_only_pass(std::uint32_t pass) {
    set_passes(1);
    first_pass_ = pass;
}

void Job::take_probe(const std::vector<double>& rays_of_spots) {
    costs_.take_probe(rays_of_spots);
    rank_anew();
}

// ------------------------------------------------------------------------------- opening, closing

void Job::plan() {
    const CellRect all = grid_.all();
    if (is_fixed()) {
        order_ = ordered_cells(all.width, all.height, submission_.order);
        fresh_end_ = grid_.count() * passes_;
        return;
    }
    if (submission_.order != protocol::TileOrder::automatic) {
        const auto blocks =
            ordered_cells(costs_.block_columns(), costs_.block_rows(), submission_.order);
        order_.resize(blocks.size());
        for (std::uint32_t rank = 0; rank < blocks.size(); ++rank)
            order_[blocks[rank]] = rank;
    }
    open_by_blocks(all, std::nullopt);
    // Machines go from frame to frame of a film.
    if (submission_.order == protocol::TileOrder::automatic && !party_->is_film())
        for (const std::size_t spot : costs_.scattered_spots())
            scouts_.push_back(costs_.spot(spot));
    scout_pixels_max_ = CostMap::scattered_share *
                        static_cast<double>(submission_.settings.crop.pixel_count()) /
                        static_cast<double>(std::max<std::size_t>(1, scouts_.size()));
}

OpenTileId Job::open(OpenTile tile) {
    const auto id = OpenTileId(++open_count_);
    enter(id, open_.emplace(id, std::move(tile)).first->second);
    return id;
}

template <class F>
void Job::for_each_block(const CellRect& cells, F deed) {
    const std::uint32_t side = costs_.block_side();
    for (std::uint32_t row = cells.row / side; row * side < cells.row + cells.height; ++row)
        for (std::uint32_t column = cells.column / side; column * side < cells.column + cells.width;
             ++column)
            deed(open_in_blocks_[std::size_t{row} * costs_.block_columns() + column]);
}

/// Anew, when its cells are not within those that it was entered with.
void Job::enter(OpenTileId id, OpenTile& tile) {
    tile.entered = tile.tile.cells;
    for_each_block(tile.entered, [&](std::vector<OpenTileId>& ids) { ids.push_back(id); });
}

void Job::leave(OpenTileId id, const OpenTile& tile) {
    for_each_block(tile.entered, [&](std::vector<OpenTileId>& ids) {
        const auto at = std::ranges::find(ids, id);
        *at = ids.back();
        ids.pop_back();
    });
}

/// All that have some of the cells, and others near by; those first that were opened first.
std::vector<OpenTileId> Job::open_about(const CellRect& cells) {
    std::vector<OpenTileId> about;
    for_each_block(cells, [&](const std::vector<OpenTileId>& ids) {
        about.insert(about.end(), ids.begin(), ids.end());
    });
    std::ranges::sort(about);
    const auto again = std::ranges::unique(about);
    about.erase(again.begin(), again.end());
    return about;
}

double Job::rank_of(const CellRect& cells, double work) const {
    return submission_.order == protocol::TileOrder::automatic
               ? -work
               : static_cast<double>(order_[costs_.block_of(cells)]);
}

void Job::push_pending(OpenTileId id) {
    OpenTile& tile = open_.at(id);
    tile.work = costs_.work(tile.tile.cells);
    tile.rank = rank_of(tile.tile.cells, tile.work);
    pending_[tile.owner].insert({tile.rank, id});
    if (is_fresh_block(tile))
        fresh_blocks_[costs_.block_of(tile.tile.cells)] = id;
}

/// All of a block, which was never handed out.
bool Job::is_fresh_block(const OpenTile& tile) const {
    return !is_fixed() && !tile.owner && !tile.was_assigned && tile.whole == OpenTileId::none &&
           tile.tile.cells == costs_.blocks(costs_.block_of(tile.tile.cells), 1);
}

void Job::erase_pending(OpenTileId id, const OpenTile& tile) {
    std::erase(requeued_, id);
    if (const auto queue = pending_.find(tile.owner); queue != pending_.end()) {
        queue->second.erase({tile.rank, id});
        if (queue->second.empty())
            pending_.erase(queue);
    }
    if (OpenTileId& fresh = fresh_blocks_[costs_.block_of(tile.tile.cells)]; fresh == id)
        fresh = OpenTileId::none;
}

/// The parts of it that are not done yet, as large as they can be, within one block.
void Job::open_undone(const CellRect& cells, const Owner& owner) {
    std::uint64_t done = 0;
    (void)grid_.all_of(cells, [&](std::uint64_t cell) {
        done += done_.test(static_cast<std::size_t>(cell));
        return true;
    });
    if (done == cells.count())
        return;
    if (done == 0)
        return push_pending(open({.tile = {0, cells}, .owner = owner}));
    const auto [first, second] = halves(cells);
    open_undone(first, owner);
    open_undone(second, owner);
}

void Job::open_by_blocks(const CellRect& cells, const Owner& owner) {
    const std::uint32_t side = is_fixed() ? 1 : costs_.block_side();
    for (std::uint32_t row = cells.row; row < cells.row + cells.height;) {
        const std::uint32_t next_row = std::min(cells.row + cells.height, (row / side + 1) * side);
        for (std::uint32_t column = cells.column; column < cells.column + cells.width;) {
            const std::uint32_t next_column =
                std::min(cells.column + cells.width, (column / side + 1) * side);
            open_undone({column, row, next_column - column, next_row - row}, owner);
            column = next_column;
        }
        row = next_row;
    }
}

void Job::assign(OpenTile& tile, const Assignment& assignment) {
    tile.was_assigned = true;
    tile.assignment = assignment;
    ++in_flight_count_;
    party_->add(assignment.peer);
    work_in_flight_ += tile.work;
    ++workers_[assignment.peer];
}

void Job::unassign(OpenTile& tile) {
    if (!tile.assignment)
        return;
    --in_flight_count_;
    party_->remove(tile.assignment->peer);
    work_in_flight_ -= tile.work;
    if (const auto worker = workers_.find(tile.assignment->peer); --worker->second == 0)
        workers_.erase(worker);
    tile.assignment.reset();
}

void Job::close(OpenTileId id) {
    const auto at = open_.find(id);
    OpenTile& tile = at->second;
    unassign(tile);
    erase_pending(id, tile);
    if (const auto whole = open_.find(tile.whole); whole != open_.end())
        --whole->second.parts;
    if (tile.parts > 0)
        for (const OpenTileId other_id : open_about(tile.entered))
            if (OpenTile& other = open_.at(other_id); other.whole == id)
                other.whole = OpenTileId::none;
    leave(id, tile);
    open_.erase(at);
}

void Job::drop_pending() {
    std::vector<OpenTileId> ids;
    for (const auto& [id, tile] : open_)
        if (!tile.assignment)
            ids.push_back(id);
    for (const OpenTileId id : ids)
        close(id);
}

/// What was thought of their work has changed.
void Job::rank_anew() {
    ranked_at_ = results_.size();
    std::vector<OpenTileId> ids;
    for (const auto& [owner, queue] : pending_)
        for (const Place& place : queue)
            ids.push_back(place.id);
    pending_.clear();
    for (const OpenTileId id : ids)
        push_pending(id);
}

// -------------------------------------------------------------------------------- what comes back

void Job::requeue(OpenTileId id) {
    OpenTile& tile = open_.at(id);
    FRAJA_ASSERT(tile.assignment.has_value());
    unassign(tile);
    if (time_is_up_ && tile.tile.pass > 0)
        return close(id);
    if (const auto whole = open_.find(tile.whole);
        whole != open_.end() && whole->second.assignment) { // somebody else is at these cells
        whole->second.covered = false;
        return close(id);
    }
    if (tile.parts > 0 && tile.covered)
        return close(id);
    requeued_.push_front(id);
}

std::uint32_t Job::count_failure(OpenTileId id, const WorkerId& worker) {
    const auto found = open_.find(id);
    if (found == open_.end())
        return 0;
    has_failures_ = true;
    found->second.failed_on.push_back(worker);
    return static_cast<std::uint32_t>(found->second.failed_on.size());
}

void Job::forgive(OpenTileId id, const WorkerId& worker) {
    const auto found = open_.find(id);
    if (found == open_.end())
        return;
    auto& failed_on = found->second.failed_on;
    const auto failure = std::ranges::find(failed_on, worker);
    if (failure == failed_on.end() || found->second.forgiven == forgiven_max)
        return;
    failed_on.erase(failure);
    ++found->second.forgiven;
}

bool Job::all_cells_done(const Tile& tile) const {
    return grid_.all_of(tile.cells,
                        [&](std::uint64_t cell) { return done_.test(bit(tile, cell)); });
}

/// Returns how many cells are new.
std::uint64_t Job::mark_done(const Tile& tile, double work) {
    std::vector<std::uint64_t> fresh;
    (void)grid_.all_of(tile.cells, [&](std::uint64_t cell) {
        if (!done_.test(bit(tile, cell))) {
            done_.set(bit(tile, cell));
            done_hash_ ^= Rng(bit(tile, cell)).next();
            fresh.push_back(cell);
        }
        return true;
    });
    if (tile.pass == 0) {
        first_pass_left_ -= fresh.size();
        if (fresh.size() == tile.cells.count())
            costs_.learn(tile.cells, work);
        else
            for (const std::uint64_t cell : fresh)
                costs_.learn(grid_.at(cell), work / static_cast<double>(tile.cells.count()));
    }
    return fresh.size();
}

std::vector<Job::Unwanted> Job::finish(OpenTileId id, const Tile& tile, double work,
                                       std::shared_ptr<const protocol::TileDone> result,
                                       Instant came_at) {
    const std::uint64_t fresh = mark_done(tile, work);
    FRAJA_ASSERT(fresh > 0);
    done_count_ += fresh;
    results_pixels_ += rect(tile).pixel_count();
    rays_ += result->rays;
    render_time_ += std::min(result->elapsed, Duration::max() - render_time_);
    const WorkerId worker = result->worker;
    results_.push_back({tile, std::move(result), came_at, worker});

    std::vector<OpenTileId> over;
    const auto answered = open_.find(id);
    if (!overlapping_ && answered != open_.end() && answered->second.tile == tile)
        over.push_back(id);
    else
        for (const OpenTileId other_id : open_about(tile.cells))
            if (const OpenTile& other = open_.at(other_id); other.tile.pass == tile.pass &&
                                                            overlap(other.tile.cells, tile.cells) &&
                                                            all_cells_done(other.tile))
                over.push_back(other_id);
    std::vector<Unwanted> unwanted;
    for (const OpenTileId other_id : over) {
        const OpenTile& other = open_.at(other_id);
        if (other.assignment)
            unwanted.push_back({other.tile, *other.assignment, other_id});
        close(other_id);
    }
    return unwanted;
}

std::optional<Tile> Job::tile_at(std::uint32_t pass, const PixelRect& rect) const {
    const auto cells = grid_.cells(rect);
    return cells && pass < passes_ && (!is_fixed() || cells->count() == 1)
               ? std::optional(Tile{pass, *cells})
               : std::nullopt;
}

bool Job::restore(const StoredTile& stored) {
    const auto cells = grid_.cells(stored.rect);
    if (!cells || stored.pass >= passes_ || index({stored.pass, *cells}) != stored.tile)
        return false;
    const Tile tile{stored.pass, *cells};
    if (distrusts(stored.worker))
        return false;
    const std::uint64_t fresh = mark_done(tile, static_cast<double>(stored.rays.total()));
    if (fresh == 0 && !is_checked()) // or it counts when others do not
        return false;
    done_count_ += fresh;
    results_pixels_ += stored.rect.pixel_count();
    rays_ += stored.rays;
    render_time_ += std::clamp(stored.elapsed, Duration::zero(), Duration::max() - render_time_);
    results_.push_back({tile, nullptr, {}, stored.worker});
    return true;
}

void Job::end_restoring() {
    (void)drop_unfinished();
    if (!is_over(phase))
        revive();
}

namespace {

/// What of `cells` lies outside of `taken`.
std::vector<CellRect> outside(const CellRect& cells, const CellRect& taken) {
    const std::uint32_t right = cells.column + cells.width, bottom = cells.row + cells.height;
    const std::uint32_t x0 = std::max(cells.column, taken.column),
                        x1 = std::min(right, taken.column + taken.width),
                        y0 = std::max(cells.row, taken.row),
                        y1 = std::min(bottom, taken.row + taken.height);
    std::vector<CellRect> rest{{cells.column, cells.row, cells.width, y0 - cells.row},
                               {cells.column, y1, cells.width, bottom - y1},
                               {cells.column, y0, x0 - cells.column, y1 - y0},
                               {x1, y0, right - x1, y1 - y0}};
    std::erase_if(rest, [](const CellRect& r) { return r.count() == 0; });
    return rest;
}

} // namespace

OpenTileId Job::adopt(const Tile& tile, const Assignment& assignment) {
    if (all_cells_done(tile))
        return OpenTileId::none;
    overlapping_ = true;
    std::vector<OpenTileId> pending;
    for (const auto& [id, other] : open_)
        if (!other.assignment && other.tile.pass == tile.pass &&
            overlap(other.tile.cells, tile.cells))
            pending.push_back(id);
    for (const OpenTileId id : pending) {
        const bool is_urgent = std::ranges::find(requeued_, id) != requeued_.end();
        OpenTile part = open_.at(id);
        close(id);
        part.whole = OpenTileId::none;
        part.parts = 0;
        part.covered = false;
        for (const CellRect& rest : outside(part.tile.cells, tile.cells)) {
            part.tile.cells = rest;
            const OpenTileId rest_id = open(part);
            if (is_urgent)
                requeued_.push_front(rest_id);
            else
                push_pending(rest_id);
        }
    }
    if (is_fixed())
        adopted_.insert(bit(tile, grid_.index(tile.cells)));
    const OpenTileId id = open({.tile = tile, .work = costs_.work(tile.cells)});
    assign(open_.at(id), assignment);
    return id;
}

std::vector<Job::Unwanted> Job::drop_unfinished() {
    std::vector<Unwanted> unwanted;
    for (const auto& [id, tile] : open_)
        if (tile.assignment)
            unwanted.push_back({tile.tile, *tile.assignment, id});
    for (const Checks::Unwanted& check : checks_.take_all_back())
        unwanted.push_back({check.tile, check.assignment});
    fresh_ = fresh_end_;
    adopted_.clear();
    open_.clear();
    for (std::vector<OpenTileId>& ids : open_in_blocks_)
        ids.clear();
    requeued_.clear();
    pending_.clear();
    std::ranges::fill(fresh_blocks_, OpenTileId::none);
    for (const auto& [peer, tiles] : workers_)
        party_->remove(peer, tiles);
    workers_.clear();
    in_flight_count_ = 0;
    work_in_flight_ = 0;
    return unwanted;
}

void Job::revive() {
    FRAJA_ASSERT(open_.empty());
    dealt_out_ = stealing_ = time_is_up_ = false;
    overlapping_ = true; // late answers may still come
    if (is_fixed()) {
        fresh_ = 0;
        fresh_end_ = grid_.count() * passes_;
    } else {
        open_by_blocks(grid_.all(), std::nullopt);
    }
}

void Job::set_time_is_up() {
    time_is_up_ = true;
    fresh_end_ = std::max(fresh_, grid_.count());
    std::vector<OpenTileId> late;
    for (const OpenTileId id : requeued_)
        if (open_.at(id).tile.pass > 0)
            late.push_back(id);
    for (const OpenTileId id : late)
        close(id);
}

// ------------------------------------------------------------------------------------------- state

std::string described(const Job& job) {
    return "job #" + std::to_string(job.number()) + " " + job.submission().job_name + " " +
           to_string(job.id());
}

std::string described(const Job& job, const Tile& tile) {
    const PixelRect r = job.rect(tile);
    return "job #" + std::to_string(job.number()) + ", tile " +
           std::to_string(static_cast<std::uint32_t>(job.index(tile))) + " (" +
           std::to_string(r.x) + "," + std::to_string(r.y) + " " + std::to_string(r.width) + "x" +
           std::to_string(r.height) + ")";
}

std::uint64_t Job::promised_bytes() const {
    const protocol::PictureSettings& s = submission_.settings;
    return passes_ * (s.crop.pixel_count() * s.pixel_bytes() + grid_.count() * tile_overhead_bytes);
}

std::uint64_t Job::stored_bytes() const {
    if (!is_over(phase))
        return promised_bytes();
    return results_pixels_ * submission_.settings.pixel_bytes() +
           results_.size() * tile_overhead_bytes;
}

protocol::JobState Job::state(std::uint64_t epoch, Instant now, const TilesBegun& begun) const {
    const protocol::PictureSettings& s = submission_.settings;
    const std::uint64_t cells = grid_.count() * protocol::pass_count(s);
    return {.epoch = epoch,
            .job = id(),
            .number = number_,
            .job_name = submission_.job_name,
            .phase = phase == protocol::JobPhase::queued && elsewhere.tiles > 0
                         ? protocol::JobPhase::running
                         : phase,
            .reason = reason,
            .scene = submission_.scene,
            .settings = s,
            .cell_side = grid_.side(),
            .cell_count = static_cast<std::uint32_t>(cells),
            .done_count = static_cast<std::uint32_t>(done_count_),
            .share_done = phase == protocol::JobPhase::done ? 1
                          : s.limited_in_time()
                              ? static_cast<double>(done_count_) / static_cast<double>(cells)
                              : costs_.share_done(begun),
            .share_per_s = s.limited_in_time() ? 0 : costs_.share_per_s(begun),
            .priority = priority,
            .in_flight_count = static_cast<std::uint32_t>(in_flight_count_) + elsewhere.tiles,
            .worker_count = static_cast<std::uint32_t>(workers_.size()) + elsewhere.workers,
            .film_worker_count =
                party_->is_film() ? static_cast<std::uint32_t>(party_->workers().size()) : 0,
            .rays = rays_,
            .render_time = render_time_,
            .elapsed = acknowledged_at ? over_at.value_or(now) - *acknowledged_at : Duration{},
            .film = submission_.wishes.film,
            .frame = submission_.wishes.frame,
            .checks = checks_.counts(),
            .distrusted = distrusted_,
            .verify = submission_.wishes.verify,
            .revision = revision};
}

} // namespace fraja::broker
