// What a worker is told at its start, and the defaults it finds out by itself.
#pragma once

#include "common/base/result.hpp"

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace fraja::worker {

inline constexpr std::uint32_t threads_max = 2048; ///< so that the credit stays within credit_max

enum class LogLevel : std::uint8_t { debug, info, warning, error };

struct WorkerOptions {
    std::vector<std::string> brokers; ///< endpoints as sockets take them; every one is served
    std::uint32_t threads = 1;        ///< render threads, shared by all brokers
    std::string name;                 ///< for people
    std::vector<std::string> tags;    ///< `K` or `K=V`
    /// Called from the thread that runs the worker, for each event; empty: silence.
    std::function<void(LogLevel, const std::string&)> on_log;
};

/// Whether the options are within the limits of the wire. The error names the option.
[[nodiscard]] Result<void> validate(const WorkerOptions& options);

/// CPUs this process may use: its affinity, and its control group's quota where there is one. At
/// least 1, at most threads_max.
[[nodiscard]] std::uint32_t usable_cpu_count();

/// HOST:PID.
[[nodiscard]] std::string default_worker_name();

} // namespace fraja::worker
