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
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace fraja::sim {
namespace {

using namespace std::chrono_literals;

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
        list_nodes();
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
        const auto& violations = farm_.report.violations;
        while (!farm_.agenda.empty() && !all_over() && farm_.agenda.next() <= end &&
               violations.empty()) // a farm that spins would take hours to come to its end
            farm_.agenda.run_next();
        farm_.report.ended_at = farm_.now().since_start;
        broker_.describe();
        if (!violations.empty())
            return std::move(farm_.report);
        for (std::size_t i = 0; i < clients_.size(); ++i)
            if (const JobReport& job = farm_.report.jobs[i]; !job.done)
                farm_.violation("job " + std::to_string(i) + " has not ended" +
                                (job.outcome.empty() ? "" : ": " + job.outcome));
        return std::move(farm_.report);
    }

private:
    void list_nodes() {
        for (const auto& branch : branches_) // before their workers
            nodes_.push_back({&branch->process(), &network_});
        for (std::size_t i = 0; i < workers_.size(); ++i) {
            const std::size_t branch = farm_.scenario.workers[i].branch;
            nodes_.push_back({&workers_[i]->process(),
                              branch == 0 ? &network_ : &branches_[branch - 1]->below()});
        }
        for (const auto& client : clients_)
            nodes_.push_back({&client->process(), &network_});
    }
    /// A worker, a branch or a client.
    Node random_node() { return nodes_[farm_.rng.below(nodes_.size())]; }
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
            const Node node = random_node();
            node.network->break_line(*node.process);
        });
        farm_.every(f.partitions_every, [this] {
            cut_off(random_group(), nodes_,
                    farm_.now() + farm_.between(0s, farm_.scenario.faults.partition_max));
        });
        farm_.every(f.worker_crashes_every, [this] { crash_somebody(); });
        farm_.every(f.broker_crashes_every, [this] { broker_.crash(); });
        farm_.every(f.hangs_every, [this] {
            Process& process = farm_.rng.below(4) == 0 ? broker_process_ : *random_node().process;
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
    /// One node with, mostly, its workers; as often with any others.
    std::set<const Process*> random_group() {
        const Process* first = random_node().process;
        const double share = farm_.rng.below(2) == 0 ? 0 : farm_.rng.unit();
        std::set<const Process*> group;
        for (const auto& [process, network] : nodes_) {
            const bool follows = group.contains(&network->broker()) && farm_.rng.below(4) > 0;
            if (process == first || follows || farm_.rng.unit() < share)
                group.insert(process);
        }
        return group;
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
    std::vector<Node> nodes_;
};

} // namespace

Report run(const Scenario& scenario) {
    return World(scenario).run();
}

} // namespace fraja::sim
