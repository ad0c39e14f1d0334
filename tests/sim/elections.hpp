// Elections: who leads, by our rule (broker/membership) or by the bully algorithm, in the same
// pretended network with the same accidents.
#pragma once

#include "common/base/instant.hpp"

#include <chrono>
#include <cstddef>
#include <cstdint>

namespace fraja::sim {

enum class ElectionRule : std::uint8_t {
    ours, ///< terms; workers answer all brokers, and watchers are anybody's
    bully ///< Garcia-Molina 1982: the highest that is up announces itself; all goes through it
};

struct ElectionPlan {
    ElectionRule rule = ElectionRule::ours;
    std::uint64_t seed = 1;
    std::size_t brokers = 3, workers = 8, watchers = 9;
    Duration time = std::chrono::hours(1);
    Duration heartbeat = std::chrono::seconds(1);
    Duration delay_max = std::chrono::milliseconds(20);
    // Of each kind the mean time between two; zero: none.
    Duration crashes_every = std::chrono::minutes(2), down_max = std::chrono::seconds(20);
    Duration partitions_every = std::chrono::minutes(2), partition_max = std::chrono::seconds(20);
    Duration hangs_every = std::chrono::minutes(2), hang_max = std::chrono::seconds(10);
};

struct ElectionReport {
    std::uint64_t tiles = 0;    ///< orders that a worker obeyed
    std::uint64_t replaced = 0; ///< of these, those by which a worker went back to a leader that it
                                ///< had left for another one
    Duration without{};         ///< nobody that is up and awake led
    Duration with_several{};    ///< two or more did, whom no cut kept apart
    std::uint64_t elections = 0; ///< times that somebody began to lead
    std::uint64_t votes = 0;     ///< messages of the election itself, beats included
    double busiest = 0;          ///< orders, answers and tiles for watchers that the busiest broker
                                 ///< moved, for each tile
};

[[nodiscard]] ElectionReport run_election(const ElectionPlan& plan);

} // namespace fraja::sim
