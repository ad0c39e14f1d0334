// The plain tables and lines that people read.
#pragma once

#include "common/protocol/messages.hpp"

#include <optional>
#include <string>
#include <vector>

namespace fraja::client {

/// Of all jobs, the newest first; a line that says so when there are none.
[[nodiscard]] std::string jobs_table(const std::vector<protocol::JobState>& jobs);
/// Of all workers, by name; a line that says so when there are none.
[[nodiscard]] std::string workers_table(const std::vector<protocol::WorkerState>& workers);

/// A broker that was asked for its farm.
struct AskedBroker {
    std::string endpoint;
    std::optional<protocol::FarmState> farm; ///< nothing: it has not answered
    std::string trouble;                     ///< why not, or why not any more; empty: all is well
    std::vector<std::string> also_at{};      ///< endpoints that lead to the same one
};
/// Of all brokers that were asked, in their order.
[[nodiscard]] std::string brokers_table(const std::vector<AskedBroker>& brokers);
/// What a farm has done since its broker started, a line each.
[[nodiscard]] std::string stats_page(const protocol::FarmState& farm);

/// `128,64  64x64  ada  0.123 s  4096 rays`, with columns that stay where they are.
[[nodiscard]] std::string tile_line(const protocol::TileDone& tile);

/// What there is to know of a job, a line each.
[[nodiscard]] std::string job_page(const protocol::JobState& state);

/// What a job's rays were and what they cost, a line each, for --stats. A sentence more where a
/// sample ran out of its budget of rays. Without what the reference kernel does not count.
[[nodiscard]] std::string counts_page(const protocol::JobState& state);

/// "12.3M": three digits and a prefix.
[[nodiscard]] std::string format_count(std::uint64_t count);

} // namespace fraja::client
