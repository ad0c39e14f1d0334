#include "common/base/freed_memory.hpp"

#include "common/base/bytes.hpp"

#include <doctest/doctest.h>
#include <fstream>
#include <thread>
#include <unistd.h>
#include <vector>

using namespace fraja;

#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)

namespace {

double resident_mib() {
    std::ifstream in("/proc/self/statm");
    double total = 0, resident = 0;
    in >> total >> resident;
    return resident * static_cast<double>(sysconf(_SC_PAGESIZE)) / (1 << 20);
}

} // namespace

TEST_CASE("freed memory is kept up to a limit, that of threads, too") {
    keep_freed_memory();
    double before = 0, held = 0, freed = 0;
    std::jthread([&] {
        before = resident_mib();
        std::vector<Bytes> pieces;
        pieces.reserve(3'000); // nothing else lies between them
        for (int i = 0; i < 3'000; ++i)
            pieces.emplace_back(100'000, std::byte{1});
        held = resident_mib();
        pieces = {};
        freed = resident_mib();
    }).join();
    CHECK(held > before + 280);
    CHECK(freed < before + 180); // and what is left of one of its parts of 64 MiB
    CHECK(freed > before + 30);
}

#endif
