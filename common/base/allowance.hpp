// What this process may have of its machine: processors and memory, by its affinity mask and by the
// limits of its control groups (cgroups(7), of either version).
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

namespace fraja {

/// A file's text; nothing where it cannot be read.
using FileReader = std::function<std::optional<std::string>(const std::string& path)>;
[[nodiscard]] std::optional<std::string> read_system_file(const std::string& path);

/// The tightest of the limits that a process's groups and all those above them have.
struct GroupLimit {
    double amount = 0; ///< above 0: processors' worth of time, or bytes
    std::string file;  ///< that says so
    friend bool operator==(const GroupLimit&, const GroupLimit&) = default;
};

/// By cpu.max, or cpu.cfs_quota_us of version 1. Nothing: there is no limit. Groups are found by
/// /proc/self/cgroup and /proc/self/mountinfo, as far up as this process sees them: in a container
/// to its own top. A file that does not read as it should says nothing.
[[nodiscard]] std::optional<GroupLimit> cpu_limit(const FileReader& read);
/// By memory.max, or memory.limit_in_bytes.
[[nodiscard]] std::optional<GroupLimit> memory_limit(const FileReader& read);

struct Processors {
    std::uint32_t usable = 1; ///< threads that are worth having: at least 1
    std::uint32_t machine = 1;
    std::string limit; ///< for people: what keeps this process from having all; empty: nothing
};

/// `affinity`: processors of the mask. A quota is used up: 1.5 processors' time keeps two threads.
[[nodiscard]] Processors processors_within(std::uint32_t machine, std::uint32_t affinity,
                                           const std::optional<GroupLimit>& quota);
/// Of the calling thread.
[[nodiscard]] Processors usable_processors();

} // namespace fraja
