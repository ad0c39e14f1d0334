#include "worker/options.hpp"

#include "common/protocol/limits.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <sched.h>
#include <unistd.h>

namespace fraja::worker {
namespace {

Error invalid(std::string message) {
    return {ErrorCode::invalid_argument, std::move(message)};
}

/// Of this process's control group (v2), as a container sees it.
std::uint32_t quota_cpu_count() {
    std::ifstream file("/sys/fs/cgroup/cpu.max");
    double quota = 0, period = 0; // "max" does not read as a number: no quota
    if (file >> quota >> period && quota > 0 && period > 0)
        return static_cast<std::uint32_t>(std::clamp(std::ceil(quota / period), 1.0, 1e6));
    return threads_max;
}

std::uint32_t affinity_cpu_count() {
    cpu_set_t set;
    CPU_ZERO(&set);
    if (sched_getaffinity(0, sizeof set, &set) != 0) // more CPUs than the set has room for
        return static_cast<std::uint32_t>(std::max(1L, sysconf(_SC_NPROCESSORS_ONLN)));
    return static_cast<std::uint32_t>(CPU_COUNT(&set));
}

} // namespace

Result<void> validate(const WorkerOptions& o) {
    if (o.brokers.empty())
        return invalid("--broker: at least one endpoint is needed");
    if (o.threads == 0 || o.threads > threads_max)
        return invalid("--threads " + std::to_string(o.threads) + ": 1 to " +
                       std::to_string(threads_max));
    if (o.name.empty() || o.name.size() > protocol::name_bytes_max)
        return invalid("--name: 1 to " + std::to_string(protocol::name_bytes_max) + " bytes");
    if (o.tags.size() > protocol::tags_max)
        return invalid("--tag: at most " + std::to_string(protocol::tags_max) + " of them");
    for (const std::string& tag : o.tags)
        if (tag.empty() || tag.starts_with('=') || tag.size() > protocol::name_bytes_max)
            return invalid("--tag '" + tag.substr(0, protocol::name_bytes_max) +
                           "': K or K=V of at most " + std::to_string(protocol::name_bytes_max) +
                           " bytes");
    return {};
}

std::uint32_t usable_cpu_count() {
    return std::clamp(std::min(affinity_cpu_count(), quota_cpu_count()), 1u, threads_max);
}

std::string default_worker_name() {
    std::array<char, 128> host{};
    if (gethostname(host.data(), host.size() - 1) != 0)
        host = {"worker"};
    return std::string(host.data()) + ":" + std::to_string(getpid());
}

} // namespace fraja::worker
