// A whole farm in pretend time: the real cores of broker, workers and clients, with a network, with
// threads and with accidents that one seed decides. The same scenario gives the same history.
#pragma once

#include "broker/limits.hpp"
#include "common/base/instant.hpp"
#include "common/protocol/messages.hpp"

#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace fraja::sim {

/// What goes wrong, until `heals_at`. Of each kind of accident the mean time between two; zero:
/// none.
struct Faults {
    Duration heals_at{};
    Duration delay_min = std::chrono::microseconds(50); ///< of every message
    Duration delay_max = std::chrono::milliseconds(2);
    /// A node's connection breaks: what is under way is lost, and it is found again.
    Duration breaks_every{};
    /// A node hears and is heard late, by up to `partition_max`; beyond `patience` its connection
    /// has broken meanwhile.
    Duration partitions_every{}, partition_max = std::chrono::seconds(20);
    Duration worker_crashes_every{}, broker_crashes_every{};
    Duration restart_max = std::chrono::seconds(5);
    /// A process stands still, as by SIGSTOP.
    Duration hangs_every{}, hang_max = std::chrono::seconds(10);
    double stream_drop = 0; ///< share of published messages that a subscriber misses
};

struct WorkerPlan {
    std::uint32_t threads = 1;
    double speed = 1; ///< that of a thread; what costs a second takes 1 / speed of it
};

struct JobPlan {
    Duration at{}; ///< when it is submitted
    protocol::PictureSettings settings;
    std::uint32_t tile_side = 0;
    std::int32_t priority = 0;
    protocol::Wishes wishes;
    std::size_t scene_bytes = 100;
    /// What rendering a tile costs, at speed 1.
    std::function<Duration(PixelRect)> cost;
};

struct Scenario {
    std::uint64_t seed = 0;
    Faults faults;
    broker::Limits limits;
    std::vector<WorkerPlan> workers;
    std::vector<JobPlan> jobs;
    /// By then every job must have ended.
    Duration ends_at = std::chrono::minutes(10);
};

struct JobReport {
    bool acknowledged = false, done = false;
    Duration submitted_at{}, done_at{};
    std::string outcome; ///< of its client, where it is no success
};

struct Report {
    std::vector<std::string> violations; ///< of what is promised; none is what is wanted
    std::vector<JobReport> jobs;
    Duration ended_at{};
    Duration busy{};           ///< of all threads, rendering tiles
    Duration useful{};         ///< of that, what was accepted first
    std::uint64_t events = 0;  ///< steps of cores
    std::uint64_t history = 0; ///< a hash of all that happened, in order
};

[[nodiscard]] Report run(const Scenario& scenario);

/// A small farm with every kind of accident, as the seed will have it.
[[nodiscard]] Scenario random_scenario(std::uint64_t seed);

} // namespace fraja::sim
