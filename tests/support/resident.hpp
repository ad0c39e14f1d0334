// How much memory a process has, for tests.
#pragma once

#include <fstream>
#include <string>
#include <sys/types.h>
#include <unistd.h>

namespace fraja {

/// Resident memory of a process, in MiB.
inline double resident_mib(pid_t pid) {
    std::ifstream in("/proc/" + std::to_string(pid) + "/statm");
    double total = 0, resident = 0;
    in >> total >> resident;
    return resident * static_cast<double>(sysconf(_SC_PAGESIZE)) / (1 << 20);
}

} // namespace fraja
