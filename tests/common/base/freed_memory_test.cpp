#include "common/base/freed_memory.hpp"

#include <cstddef>
#include <doctest/doctest.h>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

using namespace fraja;

#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)

namespace {

/// Of this process's heap, those bytes whose pages may be huge ones.
std::size_t heap_kb_for_huge_pages() {
    std::ifstream maps("/proc/self/smaps");
    std::string line;
    bool in_heap = false;
    std::size_t kb = 0, sum = 0;
    while (std::getline(maps, line)) {
        if (line.find("-") < line.find(" ") && line.find(":") > line.find(" "))
            in_heap = line.ends_with("[heap]");
        if (in_heap && line.starts_with("Size:"))
            kb = std::stoul(line.substr(5));
        if (in_heap && line.starts_with("VmFlags:") && line.find(" hg") != std::string::npos)
            sum += kb;
    }
    return sum;
}

/// In pieces that malloc takes from the heap.
std::vector<std::unique_ptr<std::byte[]>> pieces(std::size_t mib) {
    std::vector<std::unique_ptr<std::byte[]>> result;
    for (std::size_t i = 0; i < mib * 16; ++i)
        result.push_back(std::make_unique<std::byte[]>(64 << 10));
    return result;
}

} // namespace

TEST_CASE("base: of huge pages is what the heap has grown by") {
    if (!std::ifstream("/sys/kernel/mm/transparent_hugepage/enabled"))
        return; // the system has none
    HugeHeapPages heap;
    heap.ask_for_growth();
    const std::size_t before = heap_kb_for_huge_pages();
    const auto kept = pieces(32);
    CHECK(heap_kb_for_huge_pages() == before); // nobody has asked
    heap.ask_for_growth();
    const std::size_t after = heap_kb_for_huge_pages();
    CHECK(after >= before + (16 << 10));
    heap.ask_for_growth();
    CHECK(heap_kb_for_huge_pages() == after);
}

#endif
