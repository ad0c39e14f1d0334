// The broker of a pretended farm: its real core, with what its shell does.
#pragma once

#include "broker/dispatcher.hpp"
#include "tests/sim/disk.hpp"
#include "tests/sim/referee.hpp"
#include "tests/sim/site.hpp"

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace fraja::sim {

class BrokerNode {
public:
    /// One of `sites`.
    BrokerNode(Farm& farm, const Sites& sites, std::size_t index);
    BrokerNode(const BrokerNode&) = delete; // the networks know where it is
    BrokerNode& operator=(const BrokerNode&) = delete;

    void start();
    /// And starts again, in its time.
    void crash();
    void fail_disk() { disk_.fail_for(farm_.between({}, farm_.scenario.faults.disk_error_max)); }
    /// What it has to do, into the log.
    void describe() const;
    void set_clock(Duration offset) { disk_.set_clock(offset); }
    /// To the other brokers, with the networks that they are in.
    [[nodiscard]] std::vector<Node> lines();
    [[nodiscard]] bool deals_out() const { return dispatcher_ && dispatcher_->deals_out(); }

private:
    [[nodiscard]] std::uint64_t next_epoch();
    void step(broker::Event&& event);
    void perform(broker::Send&& send);
    void perform(broker::Dial&& dial);
    void perform(broker::HangUp&& gone);
    void perform(broker::Tell&& words);
    void perform(broker::Publish&& publish);
    void perform(broker::Persist&& persist) { disk_.enqueue(std::move(persist)); }
    void perform(broker::SendStored&& wish);
    void perform(broker::LoadScene&& load);
    void perform(const broker::OrderFilled&) {} // nobody orders anything of it
    void perform(const broker::OrderFailed&) {}
    void perform(broker::Log&& line) { farm_.hear_broker(name_, line.text); }

    /// To another broker.
    struct Call {
        Call(Site& s, Process& process) : site(s), line(process) {}
        Site& site;
        Line line;
    };

    Farm& farm_;
    const Sites& sites_;
    Site& site_;
    std::string name_;
    Process& process_;
    Network& network_;
    Stream& stream_;
    std::map<std::string, std::unique_ptr<Call>> calls_; ///< by endpoint
    Disk disk_;
    Referee referee_;
    std::unique_ptr<broker::Dispatcher> dispatcher_;
    std::deque<broker::Event> events_; ///< that what was done has led to
};

} // namespace fraja::sim
