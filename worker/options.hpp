// What a worker is told at its start, and the defaults it finds out by itself.
#pragma once

#include "common/base/log_line.hpp"
#include "common/base/result.hpp"

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace fraja::worker {

inline constexpr std::uint32_t threads_max = 2048; ///< so that the credit stays within credit_max
inline constexpr std::uint32_t emulated_workers_max = 10'000; ///< of one process
inline constexpr double emulated_rays_per_s_min = 1e-3, emulated_rays_per_s_max = 1e15;

/// Workers that answer when a machine of that speed would.
struct EmulatedWorkers {
    std::uint32_t count = 1;
    double rays_per_s = 1; ///< of each thread
    friend bool operator==(const EmulatedWorkers&, const EmulatedWorkers&) = default;
};

/// By a broker; the later ones are the better ones.
enum class Reception : std::uint8_t { nobody, refused, welcomed };

/// What a worker has to do.
struct Load {
    bool busy = false;                       ///< tiles are drawn, or wait for it
    std::uint64_t answers = 0;               ///< tiles that are done with, since it began
    Reception reception = Reception::nobody; ///< the best that any of its workers has had
    friend bool operator==(const Load&, const Load&) = default;
};

struct WorkerOptions {
    /// Endpoints as sockets take them and sources (common/discovery); every one is served, and so
    /// are those that stand for them.
    std::vector<std::string> brokers;
    /// In place of brokers: where to wait for them to call, tcp://HOST:PORT. Emulated workers have
    /// a port each: from that one on, or, if it is 0, what the system chooses.
    std::string listen = {};
    bool insecure = false; ///< listen where other machines can reach it, though nobody has keys
    /// Who may call a worker that listens (net::AllowList); then the context has keys. Empty: all.
    std::filesystem::path allow = {};
    std::uint32_t threads = 1;      ///< render threads, shared by all brokers
    std::string name;               ///< for people
    std::vector<std::string> tags;  ///< `K` or `K=V`
    std::uint64_t memory_bytes = 0; ///< that it may have, as brokers are told; 0: no limit is known
    /// In place of one true worker: many, each with `threads`, called NAME/1, NAME/2 ..., with the
    /// tag `emulated`. Each serves every broker.
    std::vector<EmulatedWorkers> emulated;
    /// Called from the thread that runs the worker, for each event; empty: silence.
    std::function<void(const LogLine&)> on_log;
    /// Likewise, about every second: as long as its loop turns.
    std::function<void(const Load&)> on_turn = {};
    /// Likewise, when all listen: where, in the order of their numbers.
    std::function<void(const std::vector<std::string>&)> on_listening = {};
};

/// Whether the options are within the limits of the wire. The error names the option.
[[nodiscard]] Result<void> validate(const WorkerOptions& options);

/// "COUNT@SPEED": how many, and rays per second and thread, "3500", "3.5k", "2M", "1G".
[[nodiscard]] Result<EmulatedWorkers> parse_emulated_workers(std::string_view text);
/// One for each broker of each worker; of brokers that are told of there come more.
[[nodiscard]] std::uint64_t session_count(const WorkerOptions& options);
/// Where each of so many workers listens. The error names the option.
[[nodiscard]] Result<std::vector<std::string>>
listening_endpoints(const std::string& listen, bool insecure, std::uint64_t count);
/// All of them.
[[nodiscard]] std::uint64_t emulated_count(const WorkerOptions& options);

/// CPUs this process may use (common/base/allowance.hpp). At least 1, at most threads_max.
[[nodiscard]] std::uint32_t usable_cpu_count();

/// HOST:PID.
[[nodiscard]] std::string default_worker_name();

} // namespace fraja::worker
