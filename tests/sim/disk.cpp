#include "tests/sim/disk.hpp"

#include <algorithm>
#include <chrono>
#include <variant>

namespace fraja::sim {
namespace {

using namespace std::chrono_literals;

constexpr Duration retry_pause = 2s; // WriterOptions'

} // namespace

Disk::Disk(Farm& farm)
    : farm_(farm), written_(farm.scenario.limits.tombstones_max),
      synced_(farm.scenario.limits.tombstones_max) {}

Duration Disk::wall_now() const {
    constexpr Duration epoch = 24h * 365 * 50;
    return epoch + farm_.now().since_start + clock_offset_;
}

void Disk::enqueue(broker::Persist&& persist) {
    queue_.emplace_back(persist.sequence, std::move(persist.write));
    if (!committing_)
        begin_commit();
}

void Disk::begin_commit() {
    committing_ = true;
    if (batch_.empty())
        for (auto& [sequence, write] : std::exchange(queue_, {})) {
            batch_sequence_ = sequence;
            batch_.push_back(std::move(write));
        }
    farm_.agenda.after(farm_.between(Duration::zero(), farm_.scenario.store.commit_max),
                       [this, life = life_] {
                           if (life_ == life)
                               end_commit();
                       });
}

void Disk::end_commit() {
    if (farm_.now() < fails_until_) {
        if (!std::exchange(in_trouble_, true))
            tell(broker::StoreFails{"the pretended disk is full"});
        farm_.agenda.after(retry_pause, [this, life = life_] {
            if (life_ == life)
                begin_commit();
        });
        return;
    }
    apply_batch();
    committing_ = false;
    const std::uint64_t life = life_, sequence = batch_sequence_;
    if (std::exchange(in_trouble_, false))
        tell(broker::StoreWorks{});
    tell(broker::Stored{sequence});
    if (life_ == life && !queue_.empty() && !committing_)
        begin_commit();
}

void Disk::apply_batch() {
    const bool syncs = std::ranges::any_of(batch_, broker::wants_sync);
    for (broker::Write& write : batch_) {
        written_.put(write, wall_now());
        unsynced_.push_back(std::move(write));
    }
    batch_.clear();
    if (!syncs)
        return;
    for (const broker::Write& write : std::exchange(unsynced_, {}))
        synced_.put(write, wall_now());
}

void Disk::crash(bool machine) {
    ++life_;
    if (committing_ && !batch_.empty() && farm_.now() >= fails_until_ && farm_.rng.below(2) == 0)
        apply_batch();
    batch_.clear();
    queue_.clear();
    committing_ = in_trouble_ = false;
    if (machine)
        written_ = synced_;
    unsynced_.clear();
    if (!machine)
        synced_ = written_; // the system writes it in its time
}

void Disk::fail_for(Duration time) {
    fails_until_ = std::max(fails_until_, farm_.now() + time);
}

} // namespace fraja::sim
