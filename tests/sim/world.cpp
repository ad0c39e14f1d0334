// A whole farm in pretend time: its nodes put together, and the accidents that befall them.
#include "tests/sim/administrator.hpp"
#include "tests/sim/branch_node.hpp"
#include "tests/sim/broker_node.hpp"
#include "tests/sim/client_node.hpp"
#include "tests/sim/scenario.hpp"
#include "tests/sim/worker_node.hpp"

#include <algorithm>
#include <chrono>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace fraja::sim {
namespace {

using namespace std::chrono_literals;

/// A connection that is silent for so long is given up by ZeroMQ (net/sockets.cpp).
constexpr Duration connection_patience = 30s;

/// When all is healed partitions and hangs may go on for a while, and then leases must end.
constexpr Duration leases_end = 4min, lease_patience = 30s;

class World {
public:
    explicit World(const Scenario& scenario)
        : farm_(scenario), network_(farm_, broker_process_),
          stream_(farm_, network_, broker_process_),
          broker_(farm_, broker_process_, network_, stream_),
          administrator_(farm_, network_, stream_, clients_) {
        for (std::size_t i = 0; i < scenario.branches; ++i)
            branches_.push_back(std::make_unique<BranchNode>(farm_, network_, i));
        for (std::size_t i = 0; i < scenario.workers.size(); ++i) {
            const std::size_t branch = scenario.workers[i].branch;
            Network& network = branch == 0 ? network_ : branches_[branch - 1]->below();
            workers_.push_back(std::make_unique<WorkerNode>(farm_, network, i));
        }
        for (std::size_t i = 0; i < scenario.jobs.size(); ++i)
            clients_.push_back(std::make_unique<ClientNode>(farm_, network_, stream_, i));
    }

    Report run() {
        broker_.start();
        for (const auto& branch : branches_)
            branch->start();
        for (const auto& worker : workers_)
            worker->start();
        for (std::size_t i = 0; i < clients_.size(); ++i)
            farm_.agenda.after(farm_.scenario.jobs[i].at, [this, i] { clients_[i]->start(); });
        plan_accidents();
        const Instant end = Instant{} + farm_.scenario.ends_at;
        while (!farm_.agenda.empty() && !all_over() && farm_.agenda.next() <= end)
            farm_.agenda.run_next();
        farm_.report.ended_at = farm_.now().since_start;
        broker_.describe();
        for (std::size_t i = 0; i < clients_.size(); ++i)
            if (const JobReport& job = farm_.report.jobs[i]; !job.done)
                farm_.violation("job " + std::to_string(i) + " has not ended" +
                                (job.outcome.empty() ? "" : ": " + job.outcome));
        return std::move(farm_.report);
    }

private:
    /// A worker, a branch or a client, and the network that it is a node of.
    std::pair<Process*, Network*> random_node() {
        std::size_t i = farm_.rng.below(workers_.size() + branches_.size() + clients_.size());
        if (i < workers_.size()) {
            const std::size_t branch = farm_.scenario.workers[i].branch;
            return {&workers_[i]->process(),
                    branch == 0 ? &network_ : &branches_[branch - 1]->below()};
        }
        i -= workers_.size();
        if (i < branches_.size())
            return {&branches_[i]->process(), &network_};
        return {&clients_[i - branches_.size()]->process(), &network_};
    }
    void crash_somebody() {
        const std::size_t i = farm_.rng.below(workers_.size() + branches_.size());
        if (i < workers_.size())
            workers_[i]->crash();
        else
            branches_[i - workers_.size()]->crash();
    }
    void plan_accidents() {
        const Faults& f = farm_.scenario.faults;
        farm_.every(f.breaks_every, [this] {
            const auto [process, network] = random_node();
            network->break_line(*process);
        });
        farm_.every(f.partitions_every, [this] { part(random_node()); });
        farm_.every(f.worker_crashes_every, [this] { crash_somebody(); });
        farm_.every(f.broker_crashes_every, [this] { broker_.crash(); });
        farm_.every(f.hangs_every, [this] {
            Process& process = farm_.rng.below(4) == 0 ? broker_process_ : *random_node().first;
            process.frozen_until = farm_.now() + farm_.between(0s, farm_.scenario.faults.hang_max);
        });
        farm_.every(f.disk_errors_every, [this] { broker_.fail_disk(); });
        farm_.every(f.clock_jumps_every, [this] {
            const Duration max = farm_.scenario.faults.clock_jump_max;
            broker_.set_clock(farm_.between(-max, max));
        });
        if (f.controls_every > Duration::zero()) {
            farm_.every(f.controls_every, [this] { administrator_.meddle(); });
            farm_.agenda.after(f.heals_at, [this] { administrator_.undo_all(); });
        }
        if (f.hung_tiles > 0)
            farm_.agenda.after(f.heals_at + leases_end, [this] { restart_hung_workers(); });
    }
    void part(const std::pair<Process*, Network*>& node) {
        const auto [process, network] = node;
        const Duration silence = farm_.between(0s, farm_.scenario.faults.partition_max);
        process->line.silent_until = farm_.now() + silence;
        if (silence > connection_patience)
            network->break_line(*process);
    }
    /// Nothing else brings the threads back, and somebody does it in the end. By then their tiles
    /// must have been taken back.
    void restart_hung_workers() {
        for (const auto& worker : workers_) {
            if (worker->stuck_for() > farm_.scenario.limits.lease + lease_patience)
                farm_.violation("a tile that hangs was not taken back");
            if (worker->has_hung_threads() || worker->stuck_for() > Duration::zero())
                worker->crash();
        }
    }
    [[nodiscard]] bool all_over() const {
        return std::ranges::all_of(clients_, [](const auto& c) { return c->is_over(); });
    }

    Farm farm_;
    Process broker_process_;
    Network network_;
    Stream stream_;
    BrokerNode broker_;
    std::vector<std::unique_ptr<BranchNode>> branches_;
    std::vector<std::unique_ptr<WorkerNode>> workers_;
    std::vector<std::unique_ptr<ClientNode>> clients_;
    Administrator administrator_;
};

} // namespace

Report run(const Scenario& scenario) {
    return World(scenario).run();
}

} // namespace fraja::sim
