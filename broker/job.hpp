// One job in the broker: its tiles and what became of them. Pixels are bytes here.
#pragma once

#include "broker/events.hpp"
#include "common/base/ids.hpp"
#include "common/base/instant.hpp"
#include "common/protocol/bitmap.hpp"
#include "common/protocol/messages.hpp"

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace fraja::broker {

/// A tile with a worker: the job's side of a grant.
struct Assignment {
    PeerId peer;
    AttemptNumber attempt{};
};

/// Every tile is pending, assigned to one worker, or done; done is for ever.
class Job {
public:
    /// `plan`: of one pass.
    Job(protocol::SubmitJob submission, std::uint32_t number, PeerId client,
        std::vector<PixelRect> plan);

    [[nodiscard]] const protocol::SubmitJob& submission() const { return submission_; }
    [[nodiscard]] const JobId& id() const { return submission_.job; }
    [[nodiscard]] std::uint32_t number() const { return number_; }
    /// Who submitted it, and is asked for the scene.
    [[nodiscard]] const PeerId& client() const { return client_; }
    void set_client(PeerId client) { client_ = std::move(client); }

    // ------------------------------------------------------------------------------------- tiles
    [[nodiscard]] std::uint32_t tile_count() const {
        return static_cast<std::uint32_t>(results_.size());
    }
    [[nodiscard]] bool has(TileIndex tile) const { return as_index(tile) < results_.size(); }
    [[nodiscard]] const PixelRect& rect(TileIndex tile) const {
        return plan_[as_index(tile) % plan_.size()];
    }
    [[nodiscard]] std::uint32_t pass(TileIndex tile) const {
        return static_cast<std::uint32_t>(as_index(tile) / plan_.size());
    }
    [[nodiscard]] bool done(TileIndex tile) const { return results_[as_index(tile)] != nullptr; }
    /// Everything that is wanted: of a job whose time is up one pass.
    [[nodiscard]] bool all_done() const {
        return done_count_ == plan_.size() * passes_ || (time_is_up_ && first_pass_left_ == 0);
    }
    /// How many passes are drawn at most; 1 of a picture without a time limit.
    [[nodiscard]] std::uint32_t passes() const { return passes_; }
    /// Before anything is handed out, and 1 at least: so many only.
    void set_passes(std::uint32_t passes);
    /// No pass is begun any more but the first, which must be.
    void set_time_is_up();
    [[nodiscard]] bool has_pending() const;

    /// Takes the next pending tile for that worker and assigns it. A tile that failed on this
    /// worker is left to others while `workers_with_credit` says that there are any. Nothing when
    /// there is none for it.
    [[nodiscard]] std::optional<TileIndex> assign_next(const WorkerId& worker, const PeerId& peer,
                                                       std::size_t workers_with_credit);
    [[nodiscard]] const std::map<TileIndex, Assignment>& assignments() const { return assigned_; }
    [[nodiscard]] AttemptNumber attempt(TileIndex tile) const { return attempts_.at(tile); }
    /// Whether that attempt is the one the tile is assigned to now.
    [[nodiscard]] bool assigned_as(TileIndex tile, const PeerId& peer, AttemptNumber attempt) const;

    /// An assigned tile goes back to the front of the queue, if it is still wanted.
    void requeue(TileIndex tile);
    /// Counts a failure of the tile and returns how many it has had.
    std::uint32_t count_failure(TileIndex tile, const WorkerId& worker);
    /// The first answer for a tile that is not done.
    void finish(TileIndex tile, std::shared_ptr<const protocol::TileDone> result);
    /// Nothing is pending or assigned any more.
    void drop_unfinished();

    /// The finished tiles that `have` lacks, in order, until `visit(result)` says false; then how
    /// many more are left.
    template <class Visit>
    std::uint32_t missing(const protocol::Bitmap& have, Visit visit) const {
        std::uint32_t left = 0;
        bool going = true;
        for (std::size_t i = 0; i < results_.size(); ++i) {
            if (!results_[i] || have.test(i))
                continue;
            going = going && visit(*results_[i]);
            left += going ? 0 : 1;
        }
        return left;
    }

    /// Of the pixels of all tiles that it may come to have, or has if it is over, with what it
    /// costs to keep them.
    [[nodiscard]] std::uint64_t stored_bytes() const;

    // ------------------------------------------------------------------------------------- phase
    protocol::JobPhase phase = protocol::JobPhase::waiting_for_scene;
    std::string reason;
    Instant submitted_at;     ///< from then on a time limit counts
    Instant scene_came_on_at; ///< while waiting for it: when it was last asked for or came
    std::optional<Instant> acknowledged_at, over_at;

    [[nodiscard]] protocol::JobState state(std::uint64_t epoch, Instant now) const;

private:
    static std::size_t as_index(TileIndex tile) { return static_cast<std::size_t>(tile); }

    protocol::SubmitJob submission_;
    std::uint32_t number_;
    PeerId client_;
    std::vector<PixelRect> plan_;
    std::vector<std::shared_ptr<const protocol::TileDone>>
        results_; ///< pass after pass as plan_; null until done
    std::uint32_t passes_;
    std::size_t fresh_ = 0;       ///< tiles from here on were never handed out
    std::size_t fresh_end_;       ///< nor are those from here on
    std::size_t first_pass_left_; ///< its tiles that are not done
    bool time_is_up_ = false;
    std::deque<TileIndex> requeued_; ///< these go first
    std::map<TileIndex, Assignment> assigned_;
    std::map<TileIndex, AttemptNumber> attempts_; ///< of the tiles handed out and not done
    std::map<TileIndex, std::vector<WorkerId>> failed_on_;
    std::uint32_t done_count_ = 0;
    std::uint64_t done_pixels_ = 0;
    protocol::Rays rays_;
    Duration render_time_{};
};

} // namespace fraja::broker
