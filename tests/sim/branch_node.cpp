#include "tests/sim/branch_node.hpp"

#include <algorithm>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace fraja::sim {

using namespace std::chrono_literals;

BranchNode::BranchNode(Farm& farm, Network& above, Pipe* pipe, std::size_t index)
    : farm_(farm), above_(above), index_(index), below_(farm, process_) {
    line_.pipe = pipe;
    line_.hear = [this](protocol::Message&& message) {
        if (session_)
            step(worker::Received{std::move(message)});
        serve();
    };
    line_.reconnected = [this] {
        above_.in_process(process_, [this] {
            flush();
            plan_tick();
        });
    };
    process_.tick = [this] {
        step(broker::Tick{});
        if (session_ && farm_.now() >= session_->next_deadline())
            step(worker::Tick{branch_->progress({})});
        serve();
    };
    below_.broker_hears = [this](broker::PeerId peer, protocol::Message&& message) {
        step(broker::PeerSaid{std::move(peer), std::move(message)});
        serve();
    };
}

void BranchNode::start() {
    above_.begin_life(process_);
    dispatcher_ = std::make_unique<broker::Dispatcher>(
        broker::Dispatcher::Identity{.broker = farm_.make_id<BrokerId>(),
                                     .epoch = ++epoch_,
                                     .stream = "tcp://sim:50068",
                                     .is_branch = true},
        farm_.scenario.limits);
    closed_until_ = farm_.now();
    step(broker::Tick{});
    serve();
}

void BranchNode::crash() {
    if (!process_.running)
        return;
    above_.disconnect(line_);
    above_.end_life(process_);
    dispatcher_.reset();
    close();
    below_.break_all_lines();
    farm_.agenda.after(farm_.between(10ms, farm_.scenario.faults.restart_max), [this] { start(); });
}

void BranchNode::plan_tick() {
    Instant deadline = dispatcher_->next_deadline();
    if (session_)
        deadline = std::min(deadline, session_->next_deadline());
    else if (dispatcher_->thread_count() > 0)
        deadline = std::min(deadline, closed_until_);
    above_.wake(process_, deadline);
}

// ----------------------------------------------------------------------------------- as a broker

void BranchNode::step(broker::Event&& first) {
    events_.push_back(std::move(first));
    std::vector<broker::Action> actions;
    while (!events_.empty()) {
        farm_.note(4'000 + 100 * index_ + events_.front().index());
        actions.clear();
        dispatcher_->step(farm_.now(), events_.front(), actions);
        events_.pop_front();
        for (broker::Action& action : actions)
            std::visit([this](auto& a) { perform(std::move(a)); }, action);
    }
}

void BranchNode::perform(broker::Send&& send) {
    if (!below_.to_node(send.peer, std::move(send.message)))
        events_.push_back(broker::PeerUnreachable{send.peer});
}

void BranchNode::perform(const broker::OrderFilled& filled) {
    if (branch_)
        branch_->take(filled, dispatcher_->thread_count());
}

void BranchNode::perform(const broker::OrderFailed& failed) {
    if (branch_)
        branch_->take(failed);
}

void BranchNode::perform(const broker::Persist&) {
    farm_.violation("a broker without a store keeps something");
}

// ----------------------------------------------------------------------------------- as a worker

void BranchNode::greet() {
    branch_ = std::make_unique<broker::Branch>([this] { return dispatcher_->order_progress(); },
                                               Rng(farm_.rng.next()));
    session_ =
        std::make_unique<worker::Session>(worker::Identity{farm_.make_id<WorkerId>(),
                                                           "branch " + std::to_string(index_),
                                                           broker::branch_threads,
                                                           {"gpu"}},
                                          worker::Limits{});
    leaving_ = finished_ = false;
    above_.connect(line_);
    step(worker::Tick{});
}

/// Until nothing follows from anything.
void BranchNode::serve() {
    const std::uint64_t threads = dispatcher_->thread_count();
    if (!session_ && threads > 0 && farm_.now() >= closed_until_)
        greet();
    if (session_ && threads == 0 && !std::exchange(leaving_, true))
        step(worker::StopNow{});
    while (session_) {
        const auto results = branch_->take_results();
        auto events = branch_->take_events();
        if (results.empty() && events.empty())
            break;
        for (const worker::PoolResult& result : results)
            step(result.event);
        for (broker::Event& event : events)
            step(std::move(event));
    }
    if (session_ && finished_) {
        // What it has said may still arrive, or not.
        const Duration linger = farm_.rng.below(2) == 0 ? 0s : 1s;
        closed_until_ = farm_.now() + linger;
        close();
        if (linger == 0s)
            above_.disconnect(line_);
    }
    plan_tick();
}

void BranchNode::close() {
    ++line_.socket;
    session_.reset();
    branch_.reset();
    outbox_.clear();
}

void BranchNode::step(const worker::Event& event) {
    farm_.note(4'050 + 100 * index_ + event.index());
    std::vector<worker::Action> actions;
    session_->step(farm_.now(), event, actions);
    for (worker::Action& action : actions)
        std::visit([this](auto& a) { perform(std::move(a)); }, action);
    flush();
}

void BranchNode::flush() {
    while (!outbox_.empty() && above_.to_broker(line_, outbox_.front()))
        outbox_.pop_front();
}

void BranchNode::perform(worker::Send&& send) {
    if (std::holds_alternative<protocol::WorkerHello>(send.message))
        outbox_.clear();
    outbox_.push_back(std::move(send.message));
}

void BranchNode::perform(const LogLine& line) {
    farm_.hear_broker("branch " + std::to_string(index_), line.text);
}

} // namespace fraja::sim
