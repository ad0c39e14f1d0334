// The broker of a pretended farm: its real core, with what its shell does.
#pragma once

#include "broker/dispatcher.hpp"
#include "tests/sim/disk.hpp"
#include "tests/sim/network.hpp"
#include "tests/sim/referee.hpp"
#include "tests/sim/stream.hpp"

#include <cstdint>
#include <deque>
#include <memory>

namespace fraja::sim {

class BrokerNode {
public:
    /// `process` is its own, and known to network and stream.
    BrokerNode(Farm& farm, Process& process, Network& network, Stream& stream);

    void start();
    /// And starts again, in its time.
    void crash();
    void fail_disk() { disk_.fail_for(farm_.between({}, farm_.scenario.faults.disk_error_max)); }
    /// What it has to do, into the log.
    void describe() const;
    void set_clock(Duration offset) { disk_.set_clock(offset); }

private:
    void step(broker::Event&& event);
    void perform(broker::Send&& send);
    void perform(broker::Publish&& publish);
    void perform(broker::Persist&& persist) { disk_.enqueue(std::move(persist)); }
    void perform(broker::SendStored&& wish);
    void perform(broker::LoadScene&& load);
    void perform(const broker::OrderFilled&) {} // nobody orders anything of it
    void perform(const broker::OrderFailed&) {}
    void perform(broker::Log&& line) { farm_.hear_broker("broker", line.text); }

    Farm& farm_;
    Process& process_;
    Network& network_;
    Stream& stream_;
    Disk disk_;
    Referee referee_;
    std::unique_ptr<broker::Dispatcher> dispatcher_;
    std::deque<broker::Event> events_; ///< that what was done has led to
    std::uint64_t epoch_ = 0;
};

} // namespace fraja::sim
