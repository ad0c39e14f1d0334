// A broker of a pretended farm that is a worker of the one above: its real cores, with what its
// shell does.
#pragma once

#include "broker/branch.hpp"
#include "broker/dispatcher.hpp"
#include "tests/sim/network.hpp"
#include "worker/session.hpp"

#include <cstddef>
#include <deque>
#include <memory>

namespace fraja::sim {

class BranchNode {
public:
    /// `above`: where the broker is that it serves; `pipe`: null if none is on the way there.
    BranchNode(Farm& farm, Network& above, Pipe* pipe, std::size_t index);
    BranchNode(const BranchNode&) = delete; // the networks know where it is
    BranchNode& operator=(const BranchNode&) = delete;

    void start();
    /// And starts again, in its time.
    void crash();
    [[nodiscard]] Process& process() { return process_; }
    [[nodiscard]] Line& line() { return line_; }
    [[nodiscard]] Network& above() { return above_; }
    /// Where its own workers are.
    [[nodiscard]] Network& below() { return below_; }

private:
    void step(broker::Event&& event);
    void perform(broker::Send&& send);
    void perform(const broker::OrderFilled& filled);
    void perform(const broker::OrderFailed& failed);
    void perform(const broker::Dial&) {} // nobody stands for it
    void perform(const broker::HangUp&) {}
    void perform(const broker::Tell&) {}
    void perform(const broker::Publish&) {} // nobody watches
    void perform(const broker::Persist&);
    void perform(const broker::SendStored&) {}
    void perform(const broker::LoadScene&) {}

    void serve();
    void greet();
    void close();
    void step(const worker::Event& event);
    void flush();
    void perform(worker::Send&& send);
    void perform(worker::CompileScene&& action) { branch_->perform({}, std::move(action)); }
    void perform(const worker::StartTile& action) { branch_->perform({}, action); }
    void perform(const worker::StopTile& action) { branch_->perform({}, action); }
    void perform(const worker::ForgetScene& action) { branch_->perform({}, action); }
    void perform(const worker::HangUp&) {}
    void perform(const LogLine& line); ///< of either half
    void perform(const worker::Finished&) { finished_ = true; }
    void plan_tick();

    Farm& farm_;
    Network& above_;
    std::size_t index_;
    Process process_; ///< a node above, the broker below
    Line line_{process_};
    Network below_;
    std::unique_ptr<broker::Dispatcher> dispatcher_;
    std::deque<broker::Event> events_; ///< that what was done has led to
    std::uint64_t epoch_ = 0;
    std::unique_ptr<worker::Session> session_; ///< with the broker above, while there are workers
    std::unique_ptr<broker::Branch> branch_;   ///< of the session
    std::deque<protocol::Message> outbox_;
    bool leaving_ = false, finished_ = false;
    Instant closed_until_{}; ///< no new session before
};

} // namespace fraja::sim
