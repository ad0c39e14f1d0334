// One job in the broker: its cells, the tiles they are handed out in, and what became of them.
// Pixels are bytes here.
#pragma once

#include "broker/checks.hpp"
#include "broker/contents.hpp"
#include "broker/cost_map.hpp"
#include "broker/events.hpp"
#include "broker/party.hpp"
#include "common/base/ids.hpp"
#include "common/base/instant.hpp"
#include "common/protocol/bitmap.hpp"
#include "common/protocol/cells.hpp"
#include "common/protocol/messages.hpp"

#include <compare>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace fraja::broker {

/// Names an open tile, one that is not done, within its job.
enum class OpenTileId : std::uint64_t { none = 0 };

/// Every cell of every pass is done, or lies in a tile that is pending or assigned to a worker;
/// done is for ever, unless its worker turns out to answer wrong pixels. A tile that takes long may
/// be given out again in parts: then these and the whole are open together, and whoever is first is
/// right.
class Job {
public:
    Job(protocol::SubmitJob submission, std::uint32_t number, PeerId client);

    [[nodiscard]] const protocol::SubmitJob& submission() const { return submission_; }
    [[nodiscard]] const JobId& id() const { return submission_.job; }
    [[nodiscard]] std::uint32_t number() const { return number_; }
    void set_number(std::uint32_t number) { number_ = number; }
    /// Who submitted it, and is asked for the scene.
    [[nodiscard]] const PeerId& client() const { return client_; }
    void set_client(PeerId client) { client_ = std::move(client); }
    /// With whose jobs it shares the farm as one; at first it is alone.
    [[nodiscard]] const Party& party() const { return *party_; }
    /// Before anything is handed out.
    void join(std::shared_ptr<Party> party) { party_ = std::move(party); }

    // ------------------------------------------------------------------------------------- cells
    [[nodiscard]] const protocol::CellGrid& grid() const { return grid_; }
    [[nodiscard]] const CostMap& costs() const { return costs_; }
    void take_probe(const std::vector<double>& rays_of_spots);
    void set_worth_of_rays(double worth) { costs_.set_worth(worth); }
    /// As the wire counts: of the top left cell, pass after pass.
    [[nodiscard]] TileIndex index(const Tile& tile) const {
        return TileIndex(
            static_cast<std::uint32_t>(tile.pass * grid_.count() + grid_.index(tile.cells)));
    }
    [[nodiscard]] PixelRect rect(const Tile& tile) const { return grid_.pixels(tile.cells); }
    [[nodiscard]] bool all_cells_done(const Tile& tile) const;
    /// Of all passes.
    [[nodiscard]] const protocol::Bitmap& done() const { return done_; }
    [[nodiscard]] std::uint64_t done_count() const { return done_count_; }
    [[nodiscard]] bool first_pass_done() const { return first_pass_left_ == 0; }
    /// As in protocol::JobDigest.
    [[nodiscard]] std::uint64_t done_hash() const { return done_hash_; }
    /// Nothing: it is none of this job.
    [[nodiscard]] std::optional<Tile> tile_at(std::uint32_t pass, const PixelRect& rect) const;
    /// What such a message brings, whoever handed it out; nothing: it is no whole tile of this job.
    [[nodiscard]] std::optional<Tile> tile_of(const auto& message) const {
        const auto tile = tile_at(message.pass, message.rect);
        const bool is_whole = tile && index(*tile) == message.tile &&
                              byte_count(message.blobs) ==
                                  message.rect.pixel_count() * submission_.settings.pixel_bytes();
        return is_whole ? tile : std::nullopt;
    }
    [[nodiscard]] const Tile& tile(OpenTileId id) const { return open_.at(id).tile; }
    /// Everything that is wanted: of a job whose time is up one pass.
    [[nodiscard]] bool all_done() const {
        return done_count_ == grid_.count() * passes_ || (time_is_up_ && first_pass_left_ == 0);
    }
    /// Of all passes: those that are not done.
    [[nodiscard]] std::uint64_t cells_left() const { return grid_.count() * passes_ - done_count_; }
    /// How many passes are drawn at most; 1 of a picture without a time limit.
    [[nodiscard]] std::uint32_t passes() const { return passes_; }
    /// Before anything is handed out, and 1 at least: so many only.
    void set_passes(std::uint32_t passes);
    /// Before anything is handed out: that one alone. Here it is called 0.
    void set_only_pass(std::uint32_t pass);
    /// What workers call a tile's pass.
    [[nodiscard]] std::uint32_t pass(const Tile& tile) const { return first_pass_ + tile.pass; }
    /// No pass is begun any more but the first, which must be.
    void set_time_is_up();
    [[nodiscard]] bool time_is_up() const { return time_is_up_; }

    // ------------------------------------------------------------------------------------- tiles
    /// Who asks for a tile.
    struct Bidder {
        WorkerId worker;
        PeerId peer;
        /// As much as it should be given at once; of automatic tiles, a larger one is cut.
        double work_wanted = 0;
        /// Blocks beside one another are joined up to so much, where no order was asked for.
        double joined_work_max = 0;
        /// Whether it may be one of the job's scouts, which tell what is dear before all else is
        /// handed out, and so much work they should be.
        std::optional<double> scout_work{};
        /// Whether there is anybody else who may draw it: a tile that failed on this worker is left
        /// to those on whom it did not.
        std::function<bool(std::span<const WorkerId> failed_on)> has_others;
        AttemptNumber attempt{}; ///< under which it is handed out; never used before
    };
    struct Handed {
        OpenTileId id{};
        Tile tile;
        double work = 0; ///< that it is thought to be
    };
    /// Takes the next pending tile for that worker and assigns it. Nothing when there is none for
    /// it.
    [[nodiscard]] std::optional<Handed> assign_next(const Bidder& bidder);
    [[nodiscard]] bool has_pending() const;
    [[nodiscard]] std::size_t in_flight_count() const { return in_flight_count_; }
    /// Work of the tiles in flight.
    [[nodiscard]] double work_in_flight() const { return std::max(0.0, work_in_flight_); }
    /// Tiles of it at workers, by worker.
    [[nodiscard]] const std::map<PeerId, std::uint32_t>& workers() const { return workers_; }
    /// Whether the tile is open and that attempt is the one it is assigned to now.
    [[nodiscard]] bool assigned_as(OpenTileId id, AttemptNumber attempt) const;
    /// Likewise, and no parts of it are open beside it.
    [[nodiscard]] bool assigned_alone_as(OpenTileId id, AttemptNumber attempt) const {
        return assigned_as(id, attempt) && !open_.at(id).covered;
    }

    /// For schedules that deal everything out at the start: what is pending belongs to these
    /// workers, to each as much as its share says, of the pixels or of the work. Whoever else asks
    /// gets nothing, unless `stealing`: then of whoever has most left. What is requeued is
    /// anybody's.
    struct Share {
        WorkerId worker;
        double share = 1;
    };
    void deal_out(const std::vector<Share>& shares, bool by_work, bool stealing);
    [[nodiscard]] bool is_dealt_out() const { return dealt_out_; }
    /// That worker does not come back: what is left of its share is anybody's.
    void release_share(const WorkerId& worker);

    /// An assigned tile takes too long: its cells become pending once more, in at most `parts`
    /// tiles, before all others. Of a tile that cannot be cut there is one part.
    void overbook(OpenTileId id, std::uint32_t parts);
    /// Not a tile whose parts are open already, nor parts of parts of parts.
    [[nodiscard]] bool can_overbook(OpenTileId id) const;
    [[nodiscard]] bool can_cut(const Tile& tile) const {
        return !is_fixed() && tile.cells.count() > 1;
    }

    /// An assigned tile goes back to the front of the queue, if it is still wanted.
    void requeue(OpenTileId id);
    /// Counts a failure of the tile, if it is still open, and returns how many it has had.
    std::uint32_t count_failure(OpenTileId id, const WorkerId& worker);
    /// One of these was none, if the tile is still whole; but not for ever.
    void forgive(OpenTileId id, const WorkerId& worker);
    /// Some tile of it has ever failed.
    [[nodiscard]] bool has_failures() const { return has_failures_; }
    /// Some cell of it has been at two workers at once.
    [[nodiscard]] bool was_overbooked() const { return overlapping_; }

    /// A worker has a tile in hand that another broker gave it. What is pending of its cells is
    /// not any more. None: all of it is done.
    [[nodiscard]] OpenTileId adopt(const Tile& tile, const Assignment& assignment);

    /// What is not needed any more: it is at that worker.
    struct Unwanted {
        Tile tile;
        Assignment assignment;
        OpenTileId id{};
    };
    /// An answer has come, for a tile with at least one cell that is not done; for one that was
    /// not handed out here (none), too. `work`: what it was, as in CostMap.
    [[nodiscard]] std::vector<Unwanted> finish(OpenTileId id, const Tile& tile, double work,
                                               std::shared_ptr<const protocol::TileDone> result,
                                               Instant came_at = {});
    /// Nothing is pending or assigned any more. What was assigned.
    [[nodiscard]] std::vector<Unwanted> drop_unfinished();
    /// What is not done is pending again, and its failures are forgotten. After drop_unfinished().
    void revive();

    /// A finished tile; its pixels until the store has them.
    struct Result {
        Tile tile;
        std::shared_ptr<const protocol::TileDone> pixels;
        Instant came_at{};
        WorkerId worker{};
        bool is_void = false; ///< it does not count any more
    };
    [[nodiscard]] const std::vector<Result>& results() const { return results_; }
    void release_pixels(std::size_t result) { results_.at(result).pixels.reset(); }
    /// A tile that was finished under another broker, before anything is handed out. False: it is
    /// none of this job, or brings nothing.
    bool restore(const StoredTile& stored);
    /// All that was is restored: what is left is pending.
    void end_restoring();

    /// The finished tiles with cells that `have` lacks, in the order in which they came, until
    /// `visit(result)` says false; then how many more are left.
    template <class Visit>
    std::uint32_t missing(const protocol::Bitmap& have, Visit visit) const {
        std::uint32_t left = 0;
        bool going = true;
        for (const Result& result : results_) {
            if (result.is_void || grid_.all_of(result.tile.cells, [&](std::uint64_t cell) {
                    return have.test(result.tile.pass * grid_.count() + cell);
                }))
                continue;
            going = going && visit(result);
            left += going ? 0 : 1;
        }
        return left;
    }

    /// Of the pixels of all tiles that it may come to have, with what it costs to keep them.
    [[nodiscard]] std::uint64_t promised_bytes() const;
    /// The same, or if it is over of those that it has.
    [[nodiscard]] std::uint64_t stored_bytes() const;

    // ------------------------------------------------------------------------------------ checks
    [[nodiscard]] const Checks& checks() const { return checks_; }
    void set_check_counts(const protocol::CheckCounts& counts) { checks_.set_counts(counts); }
    /// None is wanted any more. After drop_unfinished().
    void drop_checks() { checks_.clear(); }
    /// A tile that has come, or was restored, is to be checked.
    void want_check(const Tile& tile, Checks::Answer first);
    /// Takes one of the checks for that worker and assigns it.
    [[nodiscard]] std::optional<std::pair<CheckId, Tile>>
    assign_check(const WorkerId& worker, const std::string& voter, const Assignment& assignment,
                 const Checks::HasOthers& has_others);
    [[nodiscard]] bool check_assigned_as(CheckId id, AttemptNumber attempt) const;
    /// One that is assigned is pending again.
    void take_back_check(CheckId id, const std::optional<WorkerId>& failed_on);
    /// As Checks::answer, of one that is assigned.
    [[nodiscard]] std::vector<WorkerId> answer_check(CheckId id, Checks::Answer answer);
    void forgive_failed_checks() { checks_.forgive_failures(); }
    std::uint32_t give_up_checks(const Checks::HasOthers& has_others) {
        return checks_.give_up(has_others);
    }

    [[nodiscard]] const std::vector<protocol::Distrusted>& distrusted() const {
        return distrusted_;
    }
    [[nodiscard]] bool distrusts(const WorkerId& worker) const;
    /// Some of what is done was drawn by it.
    [[nodiscard]] bool has_tiles_of(const WorkerId& worker) const;
    struct Voided {
        std::vector<Tile> tiles;        ///< that do not count any more
        std::vector<Unwanted> unwanted; ///< checks of these
    };
    /// What that worker has drawn does not count any more, nor will it: it is pending again, unless
    /// the job is over. Not one that is distrusted already.
    [[nodiscard]] Voided distrust(const protocol::Distrusted& worker);
    /// Its tiles count again, if they come again.
    void trust(const WorkerId& worker);
    /// Nor do tiles whose check is open. What is in flight is dropped; all that is not done is
    /// pending.
    [[nodiscard]] Voided void_unchecked();

    /// A copy of one that is done, whose tiles are still to come from another broker: it has no
    /// scene to draw them from.
    [[nodiscard]] bool is_partial_copy() const {
        return phase == protocol::JobPhase::paused && !holds_scene;
    }

    /// A share of its tiles is drawn twice and compared.
    [[nodiscard]] bool is_checked() const { return submission_.wishes.verify > 0; }

    // ------------------------------------------------------------------------------------- phase
    protocol::JobPhase phase = protocol::JobPhase::waiting_for_scene;
    /// Its tiles are to be handed out.
    [[nodiscard]] bool may_run() const {
        return phase == protocol::JobPhase::queued || phase == protocol::JobPhase::running;
    }
    std::string reason;
    std::int32_t priority;
    enum class Probe { wanted, in_flight, over } probe = Probe::over;
    PeerId prober;            ///< who was last given the probe
    Instant submitted_at;     ///< from then on a time limit counts
    Instant scene_came_on_at; ///< while waiting for it: when it was last asked for or came
    std::optional<Instant> acknowledged_at, over_at;
    bool is_kept = false;                         ///< the store has it, or will
    bool is_being_kept = false;                   ///< and it is acknowledged then
    bool holds_scene = false;                     ///< counted in the blob store
    std::optional<WorkerId> scene_fault_found_by; ///< the first of the two that it takes
    /// Since when tiles are left to those who have the scene: once, and not for long.
    std::optional<Instant> held_since;

    // ---------------------------------------------------------------------------- several brokers
    protocol::Revision revision{};
    bool is_stored = false;              ///< while it is being kept: here it is
    bool is_adopted = false;             ///< it came from another broker
    std::optional<PeerId> retried_by{};  ///< who waits for another broker to do that
    Instant retry_until{};               ///< then
    bool leader_agrees = false;          ///< that what is awaited has become of it
    std::uint64_t done_in = 0;           ///< the last epoch whose leader has had it done like this
    Instant contest_asked_at{};          ///< when those who failed to tell who is right last were
    bool has_more_unchecked = false;     ///< done here than as it was told of last
    std::set<BrokerId> copies;           ///< who is here and has it, by its own word
    std::set<BrokerId> waiting_for_copy; ///< who is to be told when it is kept here
    Instant copied_by{}; ///< while it is being kept: then it is acknowledged without copies
    std::uint32_t number_wanted = 0; ///< another job has it at the moment; 0: it has its own
    /// A newer word about it that cannot be followed yet: its scene or tiles are still to come.
    std::optional<protocol::JobRecord> awaited;
    /// Of its tiles that another broker has handed out, by their workers' words.
    struct HandedOutElsewhere {
        std::uint32_t tiles = 0, workers = 0;
        TilesBegun begun;
    } elsewhere;

    [[nodiscard]] const protocol::Rays& rays() const { return rays_; }
    [[nodiscard]] Duration render_time() const { return render_time_; }
    /// `begun`: the tiles in flight.
    [[nodiscard]] protocol::JobState state(std::uint64_t epoch, Instant now,
                                           const TilesBegun& begun = {}) const;

private:
    /// Where a pending tile stands in its queue: the most work first, or in the order asked for.
    struct Place {
        double rank = 0;
        OpenTileId id{};
        friend auto operator<=>(const Place&, const Place&) = default;
    };
    /// Whose a pending tile is; nobody's: anybody's.
    using Owner = std::optional<WorkerId>;
    struct OpenTile {
        Tile tile{};
        double work = 0, rank = 0; ///< while it is pending
        Owner owner{};
        std::optional<Assignment> assignment{};
        std::vector<WorkerId> failed_on{};
        std::uint32_t forgiven = 0;
        bool was_assigned = false;
        OpenTileId whole{};           ///< it is a part of that one, which is open as well
        std::uint32_t parts = 0;      ///< its parts that are open
        bool covered = false;         ///< by its parts that are open or done
        protocol::CellRect entered{}; ///< in `open_in_blocks_`: its cells, and perhaps more
    };
    using OpenTiles = std::map<OpenTileId, OpenTile>;

    /// Every tile is one cell.
    [[nodiscard]] bool is_fixed() const {
        return submission_.tile_side > 0 || submission_.settings.limited_in_time();
    }
    [[nodiscard]] std::size_t bit(const Tile& tile, std::uint64_t cell) const {
        return static_cast<std::size_t>(tile.pass * grid_.count() + cell);
    }
    OpenTileId open(OpenTile tile);
    template <class F>
    void for_each_block(const protocol::CellRect& cells, F deed);
    void enter(OpenTileId id, OpenTile& tile);
    void leave(OpenTileId id, const OpenTile& tile);
    [[nodiscard]] std::vector<OpenTileId> open_about(const protocol::CellRect& cells);
    void push_pending(OpenTileId id);
    void erase_pending(OpenTileId id, const OpenTile& tile);
    void close(OpenTileId id);
    void assign(OpenTile& tile, const Assignment& assignment);
    void unassign(OpenTile& tile);
    void plan();
    void open_undone(const protocol::CellRect& cells, const Owner& owner);
    void open_by_blocks(const protocol::CellRect& cells, const Owner& owner);
    void share_out(const protocol::CellRect& cells, std::span<const Share> shares, bool by_work);
    void drop_pending();
    [[nodiscard]] OpenTileId take_pending(const Bidder& bidder);
    [[nodiscard]] OpenTileId next_fixed();
    [[nodiscard]] OpenTileId cut(OpenTileId id, double work_wanted);
    void join_blocks(OpenTileId id, double work_max);
    [[nodiscard]] OpenTileId next_scout(double work_wanted);
    [[nodiscard]] bool is_fresh_block(const OpenTile& tile) const;
    [[nodiscard]] double rank_of(const protocol::CellRect& cells, double work) const;
    void rank_anew();
    std::uint64_t mark_done(const Tile& tile, double work);
    void undo(const std::vector<Tile>& tiles);
    void void_result(Result& result);
    void open_again(const Tile& tile);
    void count_check(const PeerId& peer);
    void uncount_check(const PeerId& peer);

    protocol::SubmitJob submission_;
    std::uint32_t number_;
    PeerId client_;
    std::shared_ptr<Party> party_;
    protocol::CellGrid grid_;
    CostMap costs_;
    std::uint32_t passes_;
    std::uint32_t first_pass_ = 0;

    std::vector<std::uint32_t> order_; ///< fixed tiles: cells; explicit orders: ranks of blocks
    std::deque<protocol::CellRect> scouts_; ///< spots, each in another block, far from one another
    double scout_pixels_max_ = 0;           ///< of each
    std::uint64_t fresh_ = 0;               ///< fixed tiles from here on were never handed out
    std::uint64_t fresh_end_ = 0;           ///< nor are those from here on
    std::uint64_t open_count_ = 0;          ///< how many were ever open
    OpenTiles open_;
    /// Which of them are in each block, so that an answer need not look at all that are open.
    std::vector<std::vector<OpenTileId>> open_in_blocks_;
    std::deque<OpenTileId> requeued_;          ///< these go first
    std::map<Owner, std::set<Place>> pending_; ///< then these
    std::vector<OpenTileId> fresh_blocks_;     ///< of each block, if it is pending and fresh
    std::size_t in_flight_count_ = 0;
    double work_in_flight_ = 0;
    std::map<PeerId, std::uint32_t> workers_;
    bool has_failures_ = false;
    bool overlapping_ = false; ///< tiles have been open that share cells
    bool dealt_out_ = false, stealing_ = false;

    protocol::Bitmap done_; ///< of all passes
    std::vector<Result> results_;
    std::uint64_t first_pass_left_; ///< its cells that are not done
    bool time_is_up_ = false;
    std::uint64_t done_count_ = 0, results_pixels_ = 0, done_hash_ = 0;
    std::set<std::size_t> adopted_; ///< bits of fixed tiles that are not fresh, as others gave them
    std::size_t ranked_at_ = 0;     ///< results when pending tiles were last ranked
    Checks checks_;
    std::vector<protocol::Distrusted> distrusted_;
    protocol::Rays rays_;
    Duration render_time_{};
};

/// For the log.
[[nodiscard]] std::string described(const Job& job);
[[nodiscard]] std::string described(const Job& job, const Tile& tile);

} // namespace fraja::broker
