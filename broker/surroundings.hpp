// Surroundings: what the system says about a broker's process and its disk.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

namespace fraja::broker {

struct ProcessUsage {
    double cpu_s = 0;
    std::uint64_t resident_bytes = 0;
    std::uint64_t open_fds = 0, max_fds = 0;
    double started_at_s = 0; ///< since 1970
};

struct StoreUsage {
    std::uint64_t bytes = 0;      ///< of the file and its log
    std::uint64_t free_bytes = 0; ///< on its disk
};

/// Of this process; 0 for what the system does not tell.
[[nodiscard]] ProcessUsage process_usage();

/// Of the store in that directory; nothing where there is none. May wait for the disk.
[[nodiscard]] std::optional<StoreUsage> store_usage(const std::filesystem::path& directory);

} // namespace fraja::broker
