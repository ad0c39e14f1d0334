// The disk and the thread that writes to it (broker/store_writer), in pretend time: commits take a
// while, fail for a while, and what is not committed is lost with its process.
#pragma once

#include "broker/events.hpp"
#include "tests/sim/farm.hpp"
#include "tests/sim/kept.hpp"

#include <cstdint>
#include <deque>
#include <functional>
#include <utility>
#include <vector>

namespace fraja::sim {

class Disk {
public:
    explicit Disk(Farm& farm);

    std::function<void(broker::Event&&)> tell; ///< Stored, StoreFails, StoreWorks

    void enqueue(broker::Persist&& persist);
    /// Its broker is gone. What is being committed makes it or not; where the machine is gone, too,
    /// so are commits that were not synced.
    void crash(bool machine);
    void fail_for(Duration time);
    /// The wall clock is that far from the farm's time.
    void set_clock(Duration offset) { clock_offset_ = offset; }

    [[nodiscard]] const Kept& kept() const { return written_; }
    [[nodiscard]] Duration wall_now() const;
    std::uint64_t next_epoch(std::uint64_t at_least) {
        (void)synced_.next_epoch(at_least);
        return written_.next_epoch(at_least);
    }

private:
    void begin_commit();
    void end_commit();
    void apply_batch();

    Farm& farm_;
    Kept written_, synced_; ///< what survives the process; what survives the machine
    std::vector<broker::Write> unsynced_;
    std::deque<std::pair<std::uint64_t, broker::Write>> queue_;
    std::vector<broker::Write> batch_;
    std::uint64_t batch_sequence_ = 0;
    bool committing_ = false, in_trouble_ = false;
    std::uint64_t life_ = 0;
    Instant fails_until_{};
    Duration clock_offset_{};
};

} // namespace fraja::sim
