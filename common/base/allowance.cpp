#include "common/base/allowance.hpp"

#include "common/base/text.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <fstream>
#include <iterator>
#include <limits>
#include <sched.h>
#include <sstream>
#include <string_view>
#include <unistd.h>
#include <vector>

namespace fraja {
namespace {

/// Where a hierarchy of groups is seen, and from which of them on.
struct Mount {
    std::string root, point;
};

/// As mountinfo writes them: "\040" for a space.
std::string unescaped(std::string_view text) {
    std::string out;
    const auto digit = [&](std::size_t at) {
        return at < text.size() && text[at] >= '0' && text[at] <= '7' ? text[at] - '0' : -1;
    };
    for (std::size_t i = 0; i < text.size(); ++i) {
        const int a = digit(i + 1), b = digit(i + 2), c = digit(i + 3);
        if (text[i] == '\\' && a >= 0 && a <= 3 && b >= 0 && c >= 0) {
            out += static_cast<char>(a * 64 + b * 8 + c);
            i += 3;
        } else {
            out += text[i];
        }
    }
    return out;
}

bool lists(std::string_view comma_list, std::string_view word) {
    while (!comma_list.empty()) {
        const std::size_t end = std::min(comma_list.find(','), comma_list.size());
        if (comma_list.substr(0, end) == word)
            return true;
        comma_list.remove_prefix(std::min(end + 1, comma_list.size()));
    }
    return false;
}

/// Of the hierarchy that has that controller; empty: of version 2.
std::vector<Mount> mounts_of(std::string_view controller, const std::string& mountinfo) {
    std::vector<Mount> found;
    std::istringstream lines(mountinfo);
    for (std::string line; std::getline(lines, line);) {
        // 36 35 0:31 ROOT POINT rw,relatime shared:1 - TYPE cgroup rw,cpu
        const std::size_t dash = line.find(" - ");
        if (dash == std::string::npos)
            continue;
        std::istringstream place(line.substr(0, dash)), kind(line.substr(dash + 3));
        std::string ignored, root, point, type, controllers;
        place >> ignored >> ignored >> ignored >> root >> point;
        kind >> type >> ignored >> controllers;
        if (controller.empty() ? type == "cgroup2"
                               : type == "cgroup" && lists(controllers, controller))
            found.push_back({unescaped(root), unescaped(point)});
    }
    return found;
}

/// The group of this process in that hierarchy; nothing: there is no such hierarchy.
std::optional<std::string> group_in(std::string_view controller, const std::string& groups) {
    std::istringstream lines(groups);
    for (std::string line; std::getline(lines, line);) {
        // 4:cpu,cpuacct:/GROUP; of version 2 0::/GROUP
        const std::size_t first = line.find(':'), second = line.find(':', first + 1);
        if (first == std::string::npos || second == std::string::npos)
            continue;
        const auto controllers = std::string_view(line).substr(first + 1, second - first - 1);
        if (controller.empty() ? controllers.empty() && line.starts_with("0:")
                               : lists(controllers, controller))
            return line.substr(second + 1);
    }
    return std::nullopt;
}

/// The folders of this process's group and of all above it that are seen, the lowest first.
std::vector<std::string> folders_of(std::string_view controller, const FileReader& read) {
    const auto groups = read("/proc/self/cgroup");
    const auto mountinfo = read("/proc/self/mountinfo");
    const auto group = groups ? group_in(controller, *groups) : std::nullopt;
    if (!group || !mountinfo)
        return {};
    const auto mounts = mounts_of(controller, *mountinfo);
    for (const auto& [root, point] : mounts) {
        const std::string above = root == "/" ? "" : root;
        if (!(*group + "/").starts_with(above + "/"))
            continue; // another part of the hierarchy
        std::string below = group->substr(above.size());
        if (below == "/")
            below.clear();
        std::vector<std::string> folders;
        for (; !below.empty(); below.resize(below.rfind('/')))
            folders.push_back(point + below);
        folders.push_back(point);
        return folders;
    }
    // A container that was shown its own group alone, and not what that is called outside.
    return mounts.empty() ? std::vector<std::string>{} : std::vector{mounts.front().point};
}

std::optional<double> number(std::string_view text) {
    text = text.substr(0, text.find_last_not_of(" \n") + 1);
    const auto value = parse_count(text);
    return value ? std::optional(static_cast<double>(*value)) : std::nullopt;
}

/// "150000 100000", microseconds in a period; "max 100000": no limit.
std::optional<double> quota_v2(const std::string& folder, const FileReader& read) {
    const auto text = read(folder + "/cpu.max").value_or("");
    const std::size_t space = text.find(' ');
    if (space == std::string::npos)
        return std::nullopt;
    const auto quota = number(text.substr(0, space)), period = number(text.substr(space + 1));
    return quota && period && *period > 0 ? std::optional(*quota / *period) : std::nullopt;
}

/// -1: no limit.
std::optional<double> quota_v1(const std::string& folder, const FileReader& read) {
    const auto quota = number(read(folder + "/cpu.cfs_quota_us").value_or("")),
               period = number(read(folder + "/cpu.cfs_period_us").value_or(""));
    return quota && period && *period > 0 ? std::optional(*quota / *period) : std::nullopt;
}

std::optional<double> bytes_v2(const std::string& folder, const FileReader& read) {
    return number(read(folder + "/memory.max").value_or(""));
}

std::optional<double> bytes_v1(const std::string& folder, const FileReader& read) {
    constexpr double none = 1e18; // it says 2^63 less a page; no machine has a billion gigabytes
    const auto bytes = number(read(folder + "/memory.limit_in_bytes").value_or(""));
    return bytes && *bytes < none ? bytes : std::nullopt;
}

/// One version's way to say a limit.
struct Source {
    std::string_view controller; ///< of version 1
    const char* file;
    std::optional<double> (*amount)(const std::string& folder, const FileReader& read);
};

std::optional<GroupLimit> tightest(const std::array<Source, 2>& sources, const FileReader& read) {
    std::optional<GroupLimit> found;
    for (const Source& source : sources)
        for (const std::string& folder : folders_of(source.controller, read))
            if (const auto amount = source.amount(folder, read);
                amount && *amount > 0 && (!found || *amount < found->amount))
                found = GroupLimit{*amount, folder + "/" + source.file};
    return found;
}

std::uint32_t machine_processors() {
    return static_cast<std::uint32_t>(std::max(1L, sysconf(_SC_NPROCESSORS_ONLN)));
}

/// Grows the mask until the kernel's fits.
std::uint32_t affinity_processors() {
    constexpr std::size_t masks_max = 1024; // of 1024 processors each
    for (std::size_t masks = 1; masks <= masks_max; masks *= 2) {
        std::vector<cpu_set_t> set(masks);
        if (sched_getaffinity(0, masks * sizeof(cpu_set_t), set.data()) == 0)
            return static_cast<std::uint32_t>(CPU_COUNT_S(masks * sizeof(cpu_set_t), set.data()));
    }
    return machine_processors();
}

/// "1.5"
std::string short_number(double value) {
    std::ostringstream out;
    out.precision(3);
    out << value;
    return out.str();
}

} // namespace

std::optional<std::string> read_system_file(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    if (!file)
        return std::nullopt;
    return std::string{std::istreambuf_iterator<char>(file), {}};
}

std::optional<GroupLimit> cpu_limit(const FileReader& read) {
    return tightest({{{"", "cpu.max", quota_v2}, {"cpu", "cpu.cfs_quota_us", quota_v1}}}, read);
}

std::optional<GroupLimit> memory_limit(const FileReader& read) {
    return tightest({{{"", "memory.max", bytes_v2}, {"memory", "memory.limit_in_bytes", bytes_v1}}},
                    read);
}

Processors processors_within(std::uint32_t machine, std::uint32_t affinity,
                             const std::optional<GroupLimit>& quota) {
    Processors all{.usable = std::max(affinity, 1u), .machine = machine, .limit = {}};
    if (all.usable < machine)
        all.limit = "its affinity mask has " + std::to_string(all.usable) + " of " +
                    counted(machine, "processor");
    if (!quota || quota->amount > all.usable - 1)
        return all; // it takes no thread away
    all.usable = static_cast<std::uint32_t>(std::max(1.0, std::ceil(quota->amount)));
    all.limit = quota->file + " allows " + short_number(quota->amount) + " of " +
                counted(machine, "processor");
    return all;
}

Processors usable_processors() {
    return processors_within(machine_processors(), affinity_processors(),
                             cpu_limit(read_system_file));
}

} // namespace fraja
