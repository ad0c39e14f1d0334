// What becomes of a farm that grows: of `plan --growth`.
#pragma once

#include "common/base/instant.hpp"
#include "common/base/pixel_rect.hpp"
#include "tests/sim/work_map.hpp"

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

namespace fraja {

/// What a broker really takes: measured by `tools/bench/trees` and `tools/bench/idle_workers`, on
/// the machine that ARCHITECTURE.md names under "Growth".
struct BrokerCosts {
    double answer_us = 41;      ///< of the processor, for a tile that is handed out, taken in, told
    double mib_us = 3'200;      ///< and for each MiB of its pixels
    double beat_us = 25;        ///< for a worker's heartbeat, and the answer
    double base_mib = 8;        ///< of memory, without anybody
    double connection_kib = 31; ///< for each connection
};

struct GrowthOptions {
    std::vector<std::uint32_t> machines{10, 1'000, 100'000};
    Duration job = std::chrono::seconds(20); ///< that the best possible farm takes for the picture
    std::uint32_t sites = 4;
    Duration site_delay = std::chrono::milliseconds(40); ///< between two of them, one way
    double site_mbit_per_s = 1'000;                      ///< likewise, each way
    Duration delay = std::chrono::microseconds(100);     ///< within one
    BrokerCosts costs = {};
};

/// Prints a table in Markdown: a row for each number of machines, of one thread each, and each way
/// to connect them. Ends the program when a pretended farm breaks a promise.
void plan_growth(const GrowthOptions& options, const sim::WorkMap& work, Extent size);

} // namespace fraja
