#include "common/base/freed_memory.hpp"

#include <cstdlib>
#ifdef __GLIBC__
#include <malloc.h>
#include <sys/mman.h>
#include <unistd.h>
#endif

namespace fraja {

void keep_freed_memory() {
#ifdef __GLIBC__
    constexpr int kept_bytes = 64 << 20;
    mallopt(M_TRIM_THRESHOLD, kept_bytes);
    mallopt(M_TOP_PAD, kept_bytes);
    mallopt(M_MMAP_THRESHOLD, 4 << 20); // setting the others fixes it at 128 KiB
#endif
}

namespace {

std::uintptr_t heap_end() {
#ifdef __GLIBC__
    return reinterpret_cast<std::uintptr_t>(sbrk(0));
#else
    return 0;
#endif
}

} // namespace

HugeHeapPages::HugeHeapPages() : asked_until_(heap_end()) {}

void HugeHeapPages::ask_for_growth() {
    const std::uintptr_t end = heap_end();
    if (end == asked_until_)
        return;
#ifdef __GLIBC__
    if (end > asked_until_) {
        const auto page = static_cast<std::uintptr_t>(sysconf(_SC_PAGESIZE));
        const std::uintptr_t begin = (asked_until_ + page - 1) / page * page;
        if (begin < end) // refused: then the pages are small ones
            (void)madvise(reinterpret_cast<void*>(begin), end - begin, MADV_HUGEPAGE);
    }
#endif
    asked_until_ = end; // what is given back has to be asked for again
}

} // namespace fraja
