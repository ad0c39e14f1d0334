// The network: processes that hear and are heard late, or not at all.
#pragma once

#include "broker/events.hpp"
#include "common/protocol/messages.hpp"
#include "tests/sim/farm.hpp"

#include <algorithm>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace fraja::sim {

/// One of the farm's programs. Whatever comes to one that stands still waits, in order.
struct Process {
    std::uint64_t life = 0; ///< counts its starts and ends
    bool running = false;
    Instant frozen_until{};
    std::deque<Deed> backlog;                                        ///< of what came since
    Instant deadline = Instant::never(), planned = Instant::never(); ///< of its next tick
    std::uint32_t hurries = 0; ///< ticks that were due at once, one after the other
    std::function<void()> tick;
};

/// Between two sites, at work. Whatever takes it waits until what came before has gone through.
class Pipe {
public:
    explicit Pipe(const PipePlan& plan) : plan_(plan) {}
    /// When a message is at the other end that is sent now.
    Instant up(Instant now, std::uint64_t bytes) { return through(now, bytes, up_free_at_); }
    Instant down(Instant now, std::uint64_t bytes) { return through(now, bytes, down_free_at_); }
    [[nodiscard]] Duration delay() const { return plan_.delay; }

private:
    Instant through(Instant now, std::uint64_t bytes, Instant& free_at) const {
        free_at = std::max(free_at, now);
        if (plan_.bytes_per_s > 0)
            free_at = free_at + from_seconds(static_cast<double>(bytes) / plan_.bytes_per_s);
        return free_at + plan_.delay;
    }
    PipePlan plan_;
    Instant up_free_at_{}, down_free_at_{};
};

/// From a program to a broker and back: in order each way, but for duplicates; lost when it breaks.
struct Line {
    explicit Line(Process& process) : owner(process) {}
    Line(const Line&) = delete; // the network knows where it is
    Line& operator=(const Line&) = delete;

    Process& owner;
    std::function<void(protocol::Message&&)> hear; ///< from the broker
    std::function<void()> reconnected; ///< its socket has found the broker again by itself
    std::uint64_t socket = 0;          ///< what has come by an earlier one is not heard any more
    std::uint64_t generation = 0;      ///< of the connection; another one, another peer
    bool wanted = false;               ///< it has connected, and goes on to want that
    bool up = false;
    bool known = false;             ///< to its network
    Pipe* pipe = nullptr;           ///< that it goes through, if any
    broker::PeerId peer;            ///< while it is up
    Instant to_broker{}, to_node{}; ///< when the last message arrives
    Instant silent_until{};
    std::uint64_t hellos_said = 0, hellos_heard = 0; ///< a worker's; what is older is void
};

class Network {
public:
    Network(Farm& farm, Process& broker) : farm_(farm), broker_(broker) {}

    std::function<void(broker::PeerId, protocol::Message&&)> broker_hears;
    [[nodiscard]] const Process& broker() const { return broker_; }
    [[nodiscard]] Traffic traffic() const;
    /// From now on.
    void count_traffic() { traffic_ = {}; }

    template <class F>
    void in_process(Process& process, F deed) {
        if (!process.running)
            return;
        if (process.backlog.empty() && farm_.now() >= process.frozen_until)
            return deed();
        process.backlog.emplace_back(std::move(deed));
        if (process.backlog.size() == 1)
            thaw_when_due(process);
    }
    void begin_life(Process& process);
    void end_life(Process& process);
    /// Its tick is due then; any that was planned is not.
    void wake(Process& process, Instant deadline);

    /// A line that connects is known to the network from then on: it must stay where it is.
    void connect(Line& line);
    void disconnect(Line& line);
    void break_line(Line& line);
    /// Nothing goes through before that.
    void silence(Line& line, Instant until);
    void break_all_lines();
    /// Whether it left; then it is moved from.
    bool to_broker(Line& line, protocol::Message& message);
    /// False: there is no such peer.
    bool to_node(const broker::PeerId& peer, protocol::Message&& message);

private:
    void thaw_when_due(Process& process);
    /// The broker is, from now on, with what it has just heard.
    void be_busy(Duration service);
    void plan_tick(Process& process, Instant when);
    [[nodiscard]] Instant arrival(const Line& line, Instant& last, Instant sent);
    /// Does `arrive(message)` then, and again where it comes twice.
    template <class F>
    void plan_arrival(Instant when, protocol::Message&& message, F arrive);

    Farm& farm_;
    Process& broker_;
    std::uint64_t peers_ = 0;
    std::map<broker::PeerId, std::pair<Line*, std::uint64_t>> lines_;
    std::vector<Line*> known_;
    Traffic traffic_;
};

/// A line, and the network that it is in.
struct Node {
    Line* line;
    Network* network;
};

/// Until then nobody in `group` hears anybody who is not, nor is heard: whatever is said goes
/// through late, or is lost where the connection breaks meanwhile.
void cut_off(const std::set<const Process*>& group, const std::vector<Node>& nodes, Instant until);
/// Likewise two that do not hear each other, while everybody else hears both.
void cut_apart(const Process& one, const Process& other, const std::vector<Node>& nodes,
               Instant until);

} // namespace fraja::sim
