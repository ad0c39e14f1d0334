#include "broker/job.hpp"

#include "common/base/assert.hpp"
#include "common/protocol/passes.hpp"

#include <algorithm>
#include <set>

namespace fraja::broker {
namespace {

constexpr std::uint64_t tile_overhead_bytes = 300; // a result's own fields and allocations

} // namespace

Job::Job(protocol::SubmitJob submission, std::uint32_t number, PeerId client,
         std::vector<PixelRect> plan)
    : submission_(std::move(submission)), number_(number), client_(std::move(client)),
      plan_(std::move(plan)), results_(plan_.size() * protocol::pass_count(submission_.settings)),
      passes_(protocol::pass_count(submission_.settings)), fresh_end_(results_.size()),
      first_pass_left_(plan_.size()) {}

void Job::set_passes(std::uint32_t passes) {
    FRAJA_ASSERT(passes > 0 && passes <= passes_ && fresh_ == 0);
    passes_ = passes;
    fresh_end_ = plan_.size() * passes;
}

bool Job::has_pending() const {
    return !requeued_.empty() || fresh_ < fresh_end_;
}

std::optional<TileIndex> Job::assign_next(const WorkerId& worker, const PeerId& peer,
                                          std::size_t workers_with_credit) {
    std::optional<TileIndex> tile;
    const auto fits = [&](TileIndex t) {
        const auto failed = failed_on_.find(t);
        return failed == failed_on_.end() || failed->second.size() >= workers_with_credit ||
               std::ranges::find(failed->second, worker) == failed->second.end();
    };
    const auto requeued = std::ranges::find_if(requeued_, fits);
    if (requeued != requeued_.end()) {
        tile = *requeued;
        requeued_.erase(requeued);
    } else if (fresh_ < fresh_end_) {
        tile = TileIndex(fresh_++);
    } else {
        return std::nullopt;
    }
    const auto attempt = AttemptNumber(static_cast<std::uint32_t>(attempts_[*tile]) + 1);
    attempts_[*tile] = attempt;
    assigned_[*tile] = Assignment{peer, attempt};
    return tile;
}

bool Job::assigned_as(TileIndex tile, const PeerId& peer, AttemptNumber attempt) const {
    const auto found = assigned_.find(tile);
    return found != assigned_.end() && found->second.peer == peer &&
           found->second.attempt == attempt;
}

void Job::requeue(TileIndex tile) {
    FRAJA_ASSERT(assigned_.erase(tile) == 1 && !done(tile));
    if (!time_is_up_ || pass(tile) == 0)
        requeued_.push_front(tile);
}

std::uint32_t Job::count_failure(TileIndex tile, const WorkerId& worker) {
    auto& workers = failed_on_[tile];
    workers.push_back(worker);
    return static_cast<std::uint32_t>(workers.size());
}

void Job::finish(TileIndex tile, std::shared_ptr<const protocol::TileDone> result) {
    FRAJA_ASSERT(!done(tile));
    if (assigned_.erase(tile) == 0) // a late answer overtook the next attempt
        std::erase(requeued_, tile);
    attempts_.erase(tile);
    failed_on_.erase(tile);
    rays_ += result->rays;
    render_time_ += std::min(result->elapsed, Duration::max() - render_time_);
    results_[as_index(tile)] = std::move(result);
    if (pass(tile) == 0)
        --first_pass_left_;
    ++done_count_;
    done_pixels_ += rect(tile).pixel_count();
}

void Job::drop_unfinished() {
    fresh_ = fresh_end_;
    requeued_.clear();
    assigned_.clear();
    attempts_.clear();
    failed_on_.clear();
}

void Job::set_time_is_up() {
    time_is_up_ = true;
    fresh_end_ = std::max(fresh_, plan_.size());
    std::erase_if(requeued_, [this](TileIndex tile) { return pass(tile) > 0; });
}

std::uint64_t Job::stored_bytes() const {
    const protocol::PictureSettings& s = submission_.settings;
    const bool over = is_over(phase);
    const std::uint64_t pixels = over ? done_pixels_ : s.crop.pixel_count() * passes_;
    const std::uint64_t tiles = over ? done_count_ : plan_.size() * passes_;
    return pixels * s.pixel_bytes() + tiles * tile_overhead_bytes;
}

protocol::JobState Job::state(std::uint64_t epoch, Instant now) const {
    std::set<PeerId> workers;
    for (const auto& [tile, assignment] : assigned_)
        workers.insert(assignment.peer);
    return {.epoch = epoch,
            .job = id(),
            .number = number_,
            .job_name = submission_.job_name,
            .phase = phase,
            .reason = reason,
            .scene = submission_.scene,
            .settings = submission_.settings,
            .tile_count = tile_count(),
            .done_count = done_count_,
            .in_flight_count = static_cast<std::uint32_t>(assigned_.size()),
            .worker_count = static_cast<std::uint32_t>(workers.size()),
            .rays = rays_,
            .render_time = render_time_,
            .elapsed = acknowledged_at ? over_at.value_or(now) - *acknowledged_at : Duration{}};
}

} // namespace fraja::broker
