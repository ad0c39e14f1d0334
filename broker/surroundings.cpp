#include "broker/surroundings.hpp"

#include "broker/store_schema.hpp"
#include "common/base/resident_memory.hpp"
#include "common/net/clock.hpp"

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>
#include <sys/resource.h>
#include <system_error>
#include <unistd.h>

namespace fraja::broker {
namespace {

namespace fs = std::filesystem;

std::uint64_t open_fds() {
    std::error_code trouble;
    const fs::directory_iterator entries("/proc/self/fd", trouble);
    if (trouble)
        return 0;
    const auto count = std::distance(begin(entries), end(entries));
    return static_cast<std::uint64_t>(count - 1); // one is this look
}

std::uint64_t max_fds() {
    rlimit limit{};
    return getrlimit(RLIMIT_NOFILE, &limit) == 0 ? limit.rlim_cur : 0;
}

/// Of the machine's start, since 1970.
double booted_at_s() {
    std::ifstream file("/proc/stat");
    for (std::string line; std::getline(file, line);)
        if (line.starts_with("btime "))
            return std::strtod(line.c_str() + 6, nullptr);
    return 0;
}

double started_at_s() {
    constexpr int words_before = 19; // of proc(5)'s stat, from the 3rd to the 22nd, starttime
    std::ifstream file("/proc/self/stat");
    const std::string line{std::istreambuf_iterator<char>(file), {}};
    std::istringstream words(line.substr(std::min(line.rfind(')') + 1, line.size())));
    std::string word;
    for (int i = 0; i < words_before; ++i)
        words >> word;
    double ticks = 0;
    if (!(words >> ticks))
        return 0;
    return booted_at_s() + ticks / static_cast<double>(sysconf(_SC_CLK_TCK));
}

} // namespace

ProcessUsage process_usage() {
    return {.cpu_s = seconds(net::processor_time()),
            .resident_bytes = resident_bytes(),
            .open_fds = open_fds(),
            .max_fds = max_fds(),
            .started_at_s = started_at_s()};
}

std::optional<StoreUsage> store_usage(const fs::path& directory) {
    const fs::path file = directory / store_file_name;
    std::error_code trouble;
    const std::uint64_t bytes = fs::file_size(file, trouble);
    if (trouble)
        return std::nullopt;
    const std::uint64_t log_bytes = fs::file_size(file.string() + "-wal", trouble);
    const bool has_log = !trouble;
    const fs::space_info space = fs::space(directory, trouble);
    return StoreUsage{bytes + (has_log ? log_bytes : 0), trouble ? 0 : space.available};
}

} // namespace fraja::broker
