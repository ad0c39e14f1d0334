// Follower: gets every tile of one job, each once, over a stream that drops in silence.
//
// The stream is fast and may lose; the session is asked for what was lost. What is missing shows in
// three ways: the barrier (the subscription stands: ask for all that came before), a digest that
// counts more tiles than are here (it follows its tiles on the same connection, so they were
// dropped), and silence. PROTOCOL.md, "Watching".
#pragma once

#include "client/core.hpp"
#include "common/base/rng.hpp"
#include "common/protocol/bitmap.hpp"
#include "common/protocol/cells.hpp"

#include <cstdint>
#include <optional>
#include <vector>

namespace fraja::client {

/// What befell the follower; for logs and tests.
struct FollowerCounts {
    std::uint64_t duplicates = 0; ///< tiles that were here already
    std::uint64_t rubbish = 0;    ///< messages that contradict the job
    std::uint64_t distrusted = 0; ///< tiles of workers that the job distrusts, or of epochs before
    std::uint64_t repairs = 0;    ///< requests sent
    std::uint64_t barriers_lost = 0;
};

class Follower {
public:
    /// `state` must have passed is_sound(). `rng` makes the nonces, so its seed must differ from
    /// other watchers'.
    Follower(protocol::JobState state, Rng rng);

    /// Whether a broker's word about a job can be: counts, settings and limits.
    [[nodiscard]] static bool is_sound(const protocol::JobState& state);

    /// Begins, or begins again after the session and the stream were opened anew, or after the
    /// broker has forgotten the job, which it may know again by now. What is here stays. The stream
    /// must have been opened.
    void start(Instant now, std::vector<Action>& actions);
    void step(Instant now, const Event& event, std::vector<Action>& actions);
    [[nodiscard]] Instant next_deadline() const;

    /// The job is over, and every tile that it has is here.
    [[nodiscard]] bool is_complete() const { return complete_; }
    /// The broker does not know the job (any more).
    [[nodiscard]] bool is_forgotten() const { return forgotten_; }
    /// At least one repair was answered in full: what was finished when it was asked is here.
    [[nodiscard]] bool has_caught_up() const { return caught_up_; }

    [[nodiscard]] const protocol::JobState& state() const { return state_; } ///< the newest
    [[nodiscard]] const protocol::Bitmap& have() const { return have_; }
    /// Cells.
    [[nodiscard]] std::uint32_t have_count() const { return have_count_; }
    [[nodiscard]] const FollowerCounts& counts() const { return counts_; }

private:
    void take(Instant now, const protocol::TileDone& tile, std::vector<Action>& actions);
    void take(Instant now, const protocol::JobState& state, bool digest,
              std::vector<Action>& actions);
    void take(Instant now, const protocol::RepairDone& done, std::vector<Action>& actions);
    void take(Instant now, const protocol::Barrier& barrier, std::vector<Action>& actions);
    /// Its cells, if it is a tile of the job.
    [[nodiscard]] std::optional<protocol::CellRect> cells(const protocol::TileDone& tile) const;
    [[nodiscard]] std::vector<protocol::CellRect> take_fresh(const protocol::CellRect& cells,
                                                             std::uint32_t pass);
    [[nodiscard]] protocol::TileDone part_of(const protocol::TileDone& tile,
                                             const protocol::CellRect& cells) const;
    [[nodiscard]] bool is_lost_epoch(Instant now, const protocol::JobState& asked);
    void show(Instant now, const protocol::JobState& state, std::vector<Action>& actions);
    [[nodiscard]] bool adopt(Instant now, const protocol::JobState& state, bool asked,
                             std::vector<Action>& actions);
    void tick(Instant now, std::vector<Action>& actions);
    void raise_barrier(Instant now, std::vector<Action>& actions);
    void note_who_drew(const std::vector<protocol::CellRect>& cells, const WorkerId& worker);
    [[nodiscard]] bool distrusts(const WorkerId& worker) const;
    [[nodiscard]] bool is_of_another_epoch(const protocol::TileDone& tile) const;
    void withdraw(Instant now, std::vector<Action>& actions);
    void withdraw_all(std::vector<Action>& actions);
    void lower_barrier(std::vector<Action>& actions);
    void ask_if_due(Instant now, std::vector<Action>& actions);
    void look_whether_complete();
    [[nodiscard]] bool has_as_many_as(const protocol::JobState& state) const;

    protocol::JobState state_;
    protocol::CellGrid grid_;
    Rng rng_;
    protocol::Bitmap have_;
    std::uint32_t have_count_ = 0;
    struct Drawn {
        protocol::CellRect cells;
        std::uint32_t worker = 0; ///< in workers_
    };
    std::vector<Drawn> drawn_;      ///< what is here, each cell once: not of a job limited in time
    std::vector<WorkerId> workers_; ///< who drew it
    bool complete_ = false, forgotten_ = false, caught_up_ = false;
    Instant behind_since_ = Instant::never(); ///< an epoch that was heard of
    bool has_of_earlier_epochs_ = false;      ///< tiles that the broker may not have
    FollowerCounts counts_;

    Nonce nonce_;
    bool barrier_pending_ = false;
    Instant barrier_ends_ = Instant::never();

    bool repair_pending_ = false;     ///< asked, and not answered
    bool repair_brought_any_ = false; ///< since it was asked
    std::uint32_t odd_answers_ = 0;   ///< see odd_answers_max
    Instant repair_ends_ = Instant::never();
    Instant repair_wanted_ = Instant::never(); ///< when to ask next
};

} // namespace fraja::client
