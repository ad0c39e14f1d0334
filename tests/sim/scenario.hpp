// What a pretended farm is like and what goes wrong in it, and what is told of it in the end.
#pragma once

#include "broker/limits.hpp"
#include "common/base/instant.hpp"
#include "common/protocol/messages.hpp"
#include "tests/sim/work_map.hpp"

#include <algorithm>
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
    /// Some nodes, often one alone, are cut off from all others: across the cut everybody hears and
    /// is heard late, by up to `partition_max`; beyond the patience of a connection it has broken
    /// meanwhile. Or two do not hear each other, and all others hear both, now and then until all
    /// is healed.
    Duration partitions_every{}, partition_max = std::chrono::seconds(20);
    /// Share of messages that come twice, as if a sender did not know of the first: at once, or by
    /// up to `duplicate_lag_max` later, after others of their connection. A hello ends that: what
    /// was said before it is void.
    double duplicates = 0;
    Duration duplicate_lag_max{};
    Duration worker_crashes_every{}, broker_crashes_every{};
    Duration restart_max = std::chrono::seconds(5);
    /// A process stands still, as by SIGSTOP.
    Duration hangs_every{}, hang_max = std::chrono::seconds(10);
    double stream_drop = 0;     ///< share of published messages that a subscriber misses
    double hung_tiles = 0;      ///< share of tiles that never end and trace no ray
    double machine_crashes = 0; ///< share of the broker's crashes that its disk forgets writes in
    Duration disk_errors_every{}, disk_error_max = std::chrono::seconds(20);
    Duration clock_jumps_every{}, clock_jump_max = std::chrono::hours(24); ///< the wall clock's
    Duration controls_every{}; ///< somebody pauses and cancels jobs, and drains workers
};

struct WorkerPlan {
    std::uint32_t threads = 1;
    double rays_per_s = 1e6; ///< of a thread
    std::vector<std::string> tags;
    double lies = 0;        ///< share of the tiles that it answers wrong pixels for
    std::size_t branch = 0; ///< which broker it serves: the one above all, or a branch, from 1
    std::size_t pipe = 0;   ///< by which way: as all are, or one of the pipes, from 1
};

/// A broker that serves another one as a worker.
struct BranchPlan {
    std::size_t above = 0; ///< the one above all, or a branch that is listed before it, from 1
    std::size_t pipe = 0;  ///< as of WorkerPlan
};

/// The way between two sites, which all share whose messages take it.
struct PipePlan {
    Duration delay{};       ///< of a message, each way, beside what every one has
    double bytes_per_s = 0; ///< each way; 0: as many as there are
};

struct JobPlan {
    Duration at{}; ///< when it is submitted
    protocol::PictureSettings settings;
    std::uint32_t tile_side = 0;
    protocol::TileOrder order = protocol::TileOrder::automatic;
    std::int32_t priority = 0;
    protocol::Wishes wishes;
    std::size_t scene_bytes = 100;
    WorkMap work; ///< of a pass, that of 4 samples
};

/// How long a broker's one loop is busy with what it hears; whatever comes meanwhile waits, in
/// order.
struct ServiceTimes {
    Duration answer{}; ///< a tile that was drawn: taken in, told, and the next one handed out
    Duration mib{};    ///< each MiB of its pixels
    Duration beat{};   ///< a worker's heartbeat, and its answer
};

struct StorePlan {
    bool there = false;
    Duration commit_max = std::chrono::milliseconds(20); ///< that one takes
};

struct Scenario {
    std::uint64_t seed = 0;
    Faults faults;
    broker::Limits limits;
    StorePlan store;
    ServiceTimes service; ///< of each broker, and of each branch with those below it
    std::vector<WorkerPlan> workers;
    std::vector<BranchPlan> branches;
    std::vector<PipePlan> pipes;
    std::size_t brokers = 1; ///< that stand for each other; with more than one no branches
    std::vector<JobPlan> jobs;
    Duration compile_min = std::chrono::milliseconds(1); ///< of a scene at a worker
    Duration compile_max = std::chrono::milliseconds(50);
    bool pixels = true; ///< no: all tiles are black, and nobody looks
    std::function<void(Instant, const std::string&)> on_log; ///< what programs say; may be empty
    /// By then every job must have ended.
    Duration ends_at = std::chrono::minutes(10);
};

struct JobReport {
    bool acknowledged = false, done = false;
    Duration submitted_at{}, acknowledged_at{}, done_at{};
    std::string outcome; ///< of its client, where it is no success
    std::uint64_t wrong_cells = 0;
    std::uint32_t unchecked_tiles = 0;
};

/// What a worker's threads did.
struct WorkerReport {
    Duration busy{};                        ///< of all threads, with tiles that were answered
    Duration stopped{};                     ///< with tiles that were not wanted any more
    Duration first_start = Duration::max(); ///< of a tile
    Duration last_end{};
    std::uint64_t tiles = 0;
};

/// What has come to a broker and left it by sessions, since the first job was to be submitted.
struct Traffic {
    std::uint64_t heard = 0, said = 0; ///< messages
    std::uint64_t beats = 0;           ///< workers', of what was heard
    std::uint64_t answers = 0;         ///< tiles that were drawn, of what was heard
    std::uint64_t pixel_bytes = 0;     ///< of these
    Duration busy{};                   ///< that it was, by the scenario's service times
    std::size_t connections = 0;       ///< in the end
};

struct Report {
    std::vector<std::string> violations; ///< of what is promised; none is what is wanted
    std::vector<JobReport> jobs;
    std::vector<WorkerReport> workers;
    std::vector<Traffic> traffic; ///< of the brokers that stand for each other, then of branches
    Duration ended_at{};
    double useful_rays = 0;       ///< of what was accepted first
    Duration probe{};             ///< that probes took
    std::uint64_t events = 0;     ///< steps of cores
    std::uint64_t history = 0;    ///< a hash of all that happened, in order
    std::uint64_t restarts = 0;   ///< of the broker
    std::uint64_t tiles = 0;      ///< that clients got
    std::uint64_t duplicates = 0; ///< messages that came twice
};

[[nodiscard]] Report run(const Scenario& scenario);

[[nodiscard]] inline bool has_liars(const Scenario& scenario) {
    return std::ranges::any_of(scenario.workers, [](const WorkerPlan& w) { return w.lies > 0; });
}

/// So many brokers, none of which has branches.
void stand_for_each_other(Scenario& scenario, std::size_t brokers);
/// A small farm with every kind of accident, as the seed will have it.
[[nodiscard]] Scenario random_scenario(std::uint64_t seed);

} // namespace fraja::sim
