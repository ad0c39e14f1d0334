// A worker of a pretended farm: its real session, with threads that take time instead of rendering.
#pragma once

#include "tests/sim/network.hpp"
#include "worker/session.hpp"

#include <cstddef>
#include <deque>
#include <map>
#include <memory>
#include <set>
#include <vector>

namespace fraja::sim {

class WorkerNode {
public:
    WorkerNode(Farm& farm, Network& network, std::size_t index);
    WorkerNode(const WorkerNode&) = delete; // the network knows where it is
    WorkerNode& operator=(const WorkerNode&) = delete;

    void start();
    /// And starts again, in its time.
    void crash();
    /// For so long nothing of what it renders has moved, though there is something; 0: it moves.
    [[nodiscard]] Duration stuck_for() const;
    [[nodiscard]] bool has_hung_threads() const { return hung_threads_ > 0; }
    [[nodiscard]] Process& process() { return process_; }
    [[nodiscard]] std::vector<Node> lines() { return {{&line_, &network_}}; }

private:
    void step(const worker::Event& event);
    void flush();
    void perform(worker::Send&& send);
    void perform(worker::CompileScene&& compile);
    void perform(worker::StartTile&& start);
    void perform(worker::StopTile&& stop);
    void perform(worker::ForgetScene&& forget) { scenes_.erase(forget.scene); }
    void perform(worker::HangUp&&) {} // nobody calls here
    void perform(worker::Log&& line);
    void perform(worker::Finished&&);
    void start_waiting();
    void render(worker::StartTile&& tile);
    void end_tile(const worker::StartTile& tile, Duration time, double rays);
    [[nodiscard]] std::vector<Blob> answer(const worker::StartTile& tile) const;
    [[nodiscard]] bool lies_about(const worker::StartTile& tile) const;
    [[nodiscard]] double rays_of(const worker::StartTile& tile) const;
    [[nodiscard]] std::vector<float> probe(const worker::StartTile& tile) const;

    struct Rendering {
        Instant since{};
        bool hangs = false;
    };

    Farm& farm_;
    Network& network_;
    std::size_t index_;
    const WorkerPlan& plan_;
    Process process_;
    Line line_{process_};
    std::unique_ptr<worker::Session> session_;
    std::deque<protocol::Message> outbox_;
    std::deque<worker::StartTile> waiting_;
    std::map<worker::Ticket, Rendering> rendering_;
    std::size_t hung_threads_ = 0; ///< that do not come back
    Instant moved_{};              ///< when a tile that does not hang ended
    std::set<ContentHash> scenes_; ///< compiled
    std::uint64_t progress_ = 0;
};

} // namespace fraja::sim
