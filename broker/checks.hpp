// Checks: tiles of a job that more than one worker draws, so that one that answers wrong pixels is
// found. The same tile has the same bits, whoever draws it.
#pragma once

#include "broker/drawer.hpp"
#include "broker/events.hpp"
#include "common/base/ids.hpp"
#include "common/protocol/cells.hpp"
#include "common/protocol/messages.hpp"

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace fraja::broker {

/// What is handed out: cells of one pass.
struct Tile {
    std::uint32_t pass = 0;
    protocol::CellRect cells;
    friend bool operator==(const Tile&, const Tile&) = default;
};

/// Where a tile is: the job's side of a grant.
struct Assignment {
    PeerId peer;
    AttemptNumber attempt{};
};

/// Names an open check within its job.
enum class CheckId : std::uint64_t { none = 0 };

/// All who have one voice are one (voter_of).
class Checks {
public:
    struct Answer {
        WorkerId worker; ///< drawer_of
        std::string worker_name;
        ContentHash pixels;
        std::string voter = voter_of(worker, worker_name);
    };
    struct Check {
        Tile tile;
        std::vector<Answer> answers{}; ///< the first one's pixels are the picture's
        std::optional<Assignment> assignment{};
        std::vector<WorkerId> failed_on{}; ///< who could not draw it, by its own id
        /// All the same, so far.
        [[nodiscard]] bool agrees() const;
        /// That worker may draw it: `voter` has not said anything of it yet.
        [[nodiscard]] bool is_new_to(const WorkerId& worker, const std::string& voter) const;
    };
    /// Whether anybody is there to whom it is new.
    using HasOthers = std::function<bool(const Check&)>;

    /// A tile is to be checked that has been drawn once.
    void add(const Tile& tile, Answer first);
    [[nodiscard]] bool empty() const { return open_.empty(); }
    /// Nothing: it is closed.
    [[nodiscard]] const Check* find(CheckId id) const;
    [[nodiscard]] bool has_pending() const { return !pending_.empty() || !contested_.empty(); }
    [[nodiscard]] const protocol::CheckCounts& counts() const { return counts_; }
    void set_counts(const protocol::CheckCounts& counts) { counts_ = counts; }
    /// Of those that are open.
    [[nodiscard]] std::vector<Tile> tiles() const;
    /// Some workers disagree, and nobody else has told yet who of them is right.
    [[nodiscard]] const Check* contested() const;

    /// One that this worker may be given. Not its own tiles; but where workers disagree and there
    /// is nobody else, once more: who then contradicts itself is wrong.
    [[nodiscard]] std::optional<CheckId> next_for(const WorkerId& worker, const std::string& voter,
                                                  const HasOthers& has_others) const;
    void assign(CheckId id, Assignment assignment);
    /// It is pending again. `failed_on`: but not for that worker.
    void take_back(CheckId id, const std::optional<WorkerId>& failed_on);
    /// Where workers disagree, those who have failed to draw it may be asked again: it may be that
    /// they were lost at it, or that it was no fault of theirs.
    void forgive_failures();
    /// An answer to one that is assigned. Who must be wrong, if that can be told: each of these is
    /// to be forgotten then.
    [[nodiscard]] std::vector<WorkerId> answer(CheckId id, Answer answer);

    struct Unwanted {
        Tile tile;
        Assignment assignment;
    };
    /// Nothing that it said counts: its own tiles are not checked any more. What was assigned.
    [[nodiscard]] std::vector<Unwanted> forget(const WorkerId& worker);
    /// All go, where there is nobody for any of them and none is contested. How many. As long as
    /// one is left the others stay: somebody may come for them, too, and where the job goes on at
    /// another broker, they tell which tiles nobody has borne out.
    std::uint32_t give_up(const HasOthers& has_others);
    /// All are pending. What was assigned.
    [[nodiscard]] std::vector<Unwanted> take_all_back();
    void clear();

private:
    [[nodiscard]] static bool may_answer(const Check& check, const WorkerId& worker,
                                         const std::string& voter, const HasOthers& has_others);
    [[nodiscard]] std::set<CheckId>& queue_of(const Check& check);
    void enter(CheckId id);
    void leave(CheckId id);
    void close_if_agreed(CheckId id);

    std::map<CheckId, Check> open_;
    // Those that are not assigned. There may be one for each tile: nothing looks at all of them.
    std::map<std::string, std::set<CheckId>> pending_; ///< by who has drawn it first, a voter
    std::set<CheckId> contested_;                      ///< these go first
    std::uint64_t count_ = 0;                          ///< that were ever open
    protocol::CheckCounts counts_;
};

} // namespace fraja::broker
