// A worker of a pretended farm: its real session, with threads that take time instead of rendering.
#pragma once

#include "tests/sim/network.hpp"
#include "worker/crew.hpp"

#include <cstddef>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

namespace fraja::sim {

class WorkerNode {
public:
    /// Where its brokers are: of several that stand for each other it may know only some, which
    /// tell it of the others.
    struct Place {
        std::string endpoint;
        Network* network;
        Pipe* pipe = nullptr; ///< on the way there, if any
    };
    WorkerNode(Farm& farm, const std::vector<Place>& places, std::size_t index);
    WorkerNode(const WorkerNode&) = delete; // the network knows where it is
    WorkerNode& operator=(const WorkerNode&) = delete;

    void start();
    /// And starts again, in its time.
    void crash();
    /// For so long nothing of what it renders has moved, though there is something; 0: it moves.
    [[nodiscard]] Duration stuck_for() const;
    [[nodiscard]] bool has_hung_threads() const { return hung_threads_ > 0; }
    [[nodiscard]] Process& process() { return process_; }
    [[nodiscard]] std::vector<Node> lines();

private:
    using Index = worker::SessionIndex;
    /// To one of the brokers.
    struct Way {
        Way(Place p, Process& process) : place(std::move(p)), line(process) {}
        Place place;
        Line line;
        std::optional<Index> session; ///< that has it
        std::deque<protocol::Message> outbox;
        std::uint64_t incarnation = 0;
        // What its broker has said since it answered the last hello:
        BrokerId broker{};
        std::set<BrokerId> others{}; ///< that stand for it
        protocol::Term told{};       ///< the greatest
        using Order = std::tuple<JobId, TileIndex, AttemptNumber>;
        std::set<Order> obeyed{}, stale{}; ///< of the newest term that was known then; of others
    };
    struct Waiting {
        Index session{};
        worker::StartTile tile;
    };

    void step(const worker::CrewEvent& event);
    void note_term(Way& way, const protocol::Message& message);
    static void forget_terms(Way& way);
    [[nodiscard]] bool obeys_leader_of_before(const protocol::Message& message) const;
    void flush(Way& way);
    [[nodiscard]] Way* way_of(Index session);
    void open(Index session, Way& way);
    void close(Index session);
    void perform(Index session, worker::Send&& send);
    void perform(Index session, worker::CompileScene&& compile);
    void perform(Index session, worker::StartTile&& start);
    void perform(Index session, worker::StopTile&& stop);
    void perform(Index session, worker::ForgetScene&& forget) {
        scenes_.erase({session, forget.scene});
    }
    void perform(Index, worker::HangUp&&) {} // nobody calls here
    void perform(Index session, worker::Log&& line);
    void perform(Index session, worker::Open&& open);
    void perform(Index session, worker::Close&&) { close(session); }
    void start_waiting();
    void render(Index session, worker::StartTile&& tile);
    void end_tile(Index session, const worker::StartTile& tile, Duration time, double rays);
    [[nodiscard]] std::vector<Blob> answer(const worker::StartTile& tile) const;
    [[nodiscard]] bool lies_about(const worker::StartTile& tile) const;
    [[nodiscard]] double rays_of(const worker::StartTile& tile) const;
    [[nodiscard]] std::vector<float> probe(const worker::StartTile& tile) const;

    struct Rendering {
        Instant since{};
        bool hangs = false;
    };
    using TileKey = std::pair<Index, worker::Ticket>;

    Farm& farm_;
    std::size_t index_;
    const WorkerPlan& plan_;
    Process process_;
    std::vector<std::unique_ptr<Way>> ways_;
    std::unique_ptr<worker::Crew> crew_;
    std::deque<Waiting> waiting_;
    std::map<TileKey, Rendering> rendering_;
    std::size_t hung_threads_ = 0;                   ///< that do not come back
    Instant moved_{};                                ///< when a tile that does not hang ended
    std::set<std::pair<Index, ContentHash>> scenes_; ///< compiled
    std::uint64_t progress_ = 0;
};

} // namespace fraja::sim
