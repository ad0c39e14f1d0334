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
constexpr Duration undone_again = 3min;
constexpr Duration settles_within = 30s;

class World {
public:
    explicit World(const Scenario& scenario)
        : farm_(scenario), sites_(make_sites(farm_)), administrator_(farm_, sites_, clients_) {
        for (std::size_t i = 0; i < sites_.size(); ++i)
            brokers_.push_back(std::make_unique<BrokerNode>(farm_, sites_, i));
        for (const PipePlan& plan : scenario.pipes)
            pipes_.push_back(std::make_unique<Pipe>(plan));
        for (std::size_t i = 0; i < scenario.branches.size(); ++i) {
            const BranchPlan& plan = scenario.branches[i];
            branches_.push_back(
                std::make_unique<BranchNode>(farm_, network_of(plan.above), pipe_of(plan.pipe), i));
        }
        for (std::size_t i = 0; i < scenario.workers.size(); ++i) {
            workers_.push_back(std::make_unique<WorkerNode>(farm_, places_of(i), i));
        }
        for (std::size_t i = 0; i < scenario.jobs.size(); ++i)
            clients_.push_back(std::make_unique<ClientNode>(farm_, sites_, i));
        list_nodes();
    }

    Report run() {
        for (const auto& broker : brokers_)
            broker->start();
        for (const auto& branch : branches_)
            branch->start();
        for (const auto& worker : workers_)
            worker->start();
        for (std::size_t i = 0; i < clients_.size(); ++i)
            farm_.agenda.after(farm_.scenario.jobs[i].at, [this, i] { clients_[i]->start(); });
        plan_accidents();
        if (const auto& jobs = farm_.scenario.jobs; !jobs.empty())
            farm_.agenda.at(Instant{} + std::ranges::min(jobs, {}, &JobPlan::at).at, [this] {
                for_each_network([](Network& network) { network.count_traffic(); });
            });
        const Instant end = Instant{} + farm_.scenario.ends_at;
        const auto& violations = farm_.report.violations;
        while (!farm_.agenda.empty() && !all_over() && farm_.agenda.next() <= end &&
               violations.empty()) // a farm that spins would take hours to come to its end
            farm_.agenda.run_next();
        farm_.report.ended_at = farm_.now().since_start;
        for_each_network(
            [this](const Network& network) { farm_.report.traffic.push_back(network.traffic()); });
        for (const auto& broker : brokers_)
            broker->describe();
        if (!violations.empty())
            return std::move(farm_.report);
        if (brokers_.size() > 1 && farm_.now() > end_of_faults())
            wait_until_one_leads();
        for (std::size_t i = 0; i < clients_.size(); ++i)
            if (const JobReport& job = farm_.report.jobs[i]; !job.done)
                farm_.violation("job " + std::to_string(i) + " has not ended" +
                                (job.outcome.empty() ? "" : ": " + job.outcome));
        return std::move(farm_.report);
    }

private:
    /// On a slow network they may be about to change places.
    void wait_until_one_leads() {
        const auto leaders = [this] {
            return std::ranges::count_if(brokers_,
                                         [](const auto& broker) { return broker->deals_out(); });
        };
        const Instant end = farm_.now() + settles_within;
        while (leaders() != 1 && farm_.agenda.next() <= end)
            farm_.agenda.run_next();
        if (leaders() != 1)
            farm_.violation(std::to_string(leaders()) + " brokers deal out tiles in the end");
    }
    static Sites make_sites(Farm& farm) {
        Sites sites;
        for (std::size_t i = 0; i < farm.scenario.brokers; ++i)
            sites.push_back(std::make_unique<Site>(farm, i));
        return sites;
    }
    /// Of the broker above all: 0, or of a branch, from 1.
    [[nodiscard]] Network& network_of(std::size_t broker) {
        return broker == 0 ? sites_[0]->network : branches_[broker - 1]->below();
    }
    [[nodiscard]] Pipe* pipe_of(std::size_t number) {
        return number == 0 ? nullptr : pipes_[number - 1].get();
    }
    [[nodiscard]] std::vector<WorkerNode::Place> places_of(std::size_t worker) {
        const WorkerPlan& plan = farm_.scenario.workers[worker];
        if (plan.branch > 0)
            return {{"tcp://branch:50057", &network_of(plan.branch), pipe_of(plan.pipe)}};
        std::vector<WorkerNode::Place> places;
        for (const auto& site : sites_)
            places.push_back({site->endpoint, &site->network, pipe_of(plan.pipe)});
        return places;
    }
    template <class F>
    void for_each_network(F deed) {
        for (const auto& site : sites_)
            deed(site->network);
        for (const auto& branch : branches_)
            deed(branch->below());
    }
    void list_nodes() {
        const auto add = [this](Process& process, const std::vector<Node>& lines) {
            processes_.push_back(&process);
            lines_.insert(lines_.end(), lines.begin(), lines.end());
        };
        if (brokers_.size() > 1)
            for (std::size_t i = 0; i < brokers_.size(); ++i)
                add(sites_[i]->process, brokers_[i]->lines());
        for (const auto& branch : branches_) // before their workers
            add(branch->process(), {{&branch->line(), &branch->above()}});
        for (const auto& worker : workers_)
            add(worker->process(), worker->lines());
        for (const auto& client : clients_)
            add(client->process(), client->lines());
    }
    /// A worker, a branch or a client; of several brokers one as well.
    Process& random_process() { return *processes_[farm_.rng.below(processes_.size())]; }
    BrokerNode& random_broker() { return *brokers_[farm_.rng.below(brokers_.size())]; }
    void break_some_line() {
        Process& process = random_process();
        std::vector<Node> own;
        for (const Node& node : lines_)
            if (&node.line->owner == &process)
                own.push_back(node);
        const Node& node = own[farm_.rng.below(own.size())];
        node.network->break_line(*node.line);
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
        farm_.every(f.breaks_every, [this] { break_some_line(); });
        farm_.every(f.partitions_every, [this] { cut(); });
        farm_.every(f.worker_crashes_every, [this] { crash_somebody(); });
        farm_.every(f.broker_crashes_every, [this] { random_broker().crash(); });
        farm_.every(f.hangs_every, [this] {
            Process& process = farm_.rng.below(4) == 0
                                   ? sites_[farm_.rng.below(sites_.size())]->process
                                   : random_process();
            process.frozen_until = farm_.now() + farm_.between(0s, farm_.scenario.faults.hang_max);
        });
        farm_.every(f.disk_errors_every, [this] { random_broker().fail_disk(); });
        farm_.every(f.clock_jumps_every, [this] {
            const Duration max = farm_.scenario.faults.clock_jump_max;
            random_broker().set_clock(farm_.between(-max, max));
        });
        if (f.controls_every > Duration::zero()) {
            farm_.every(f.controls_every, [this] { administrator_.meddle(); });
            // Of several brokers one that is still cut off then may have other words.
            for (int again = 0; again < (brokers_.size() > 1 ? 3 : 1); ++again)
                farm_.agenda.after(f.heals_at + again * undone_again,
                                   [this] { administrator_.undo_all(); });
        }
        if (f.hung_tiles > 0)
            farm_.agenda.after(f.heals_at + leases_end, [this] { restart_hung_workers(); });
    }
    void cut() {
        const Faults& f = farm_.scenario.faults;
        const Instant until = farm_.now() + farm_.between(0s, f.partition_max);
        if (farm_.rng.below(3) > 0)
            return cut_off(random_group(), lines_, until);
        const Process& broker = sites_[farm_.rng.below(brokers_.size())]->process;
        const bool is_long = farm_.rng.below(4) == 0;
        cut_apart(random_process(), broker, lines_,
                  is_long ? std::max(until, Instant{} + f.heals_at) : until);
    }
    /// One process with, mostly, its workers; as often with any others.
    std::set<const Process*> random_group() {
        const Process* first = &random_process();
        const double share = farm_.rng.below(2) == 0 ? 0 : farm_.rng.unit();
        std::set<const Process*> group;
        for (const Process* process : processes_) {
            const bool follows = std::ranges::any_of(lines_, [&](const Node& node) {
                return &node.line->owner == process && group.contains(&node.network->broker());
            });
            const bool comes_along = follows && farm_.rng.below(4) > 0;
            if (process == first || comes_along || farm_.rng.unit() < share)
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
    /// Partitions, hangs and restarts are over, and what follows from them.
    [[nodiscard]] Instant end_of_faults() const {
        const Faults& f = farm_.scenario.faults;
        return Instant{} + f.heals_at + f.partition_max + f.hang_max + f.restart_max + 2min;
    }
    [[nodiscard]] bool all_over() const {
        return std::ranges::all_of(clients_, [](const auto& c) { return c->is_over(); });
    }

    Farm farm_;
    Sites sites_;
    std::vector<std::unique_ptr<Pipe>> pipes_;
    std::vector<std::unique_ptr<BrokerNode>> brokers_;
    std::vector<std::unique_ptr<BranchNode>> branches_;
    std::vector<std::unique_ptr<WorkerNode>> workers_;
    std::vector<std::unique_ptr<ClientNode>> clients_;
    Administrator administrator_;
    std::vector<Process*> processes_;
    std::vector<Node> lines_;
};

} // namespace

Report run(const Scenario& scenario) {
    return World(scenario).run();
}

} // namespace fraja::sim
