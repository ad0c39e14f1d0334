#include "common/base/freed_memory.hpp"

#include "common/base/assert.hpp"

#include <climits>
#include <cstdlib>
#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace fraja {

void keep_freed_memory([[maybe_unused]] std::size_t bytes) {
#ifdef __GLIBC__
    FRAJA_ASSERT(bytes <= INT_MAX);
    const int kept = static_cast<int>(bytes);
    mallopt(M_TRIM_THRESHOLD, kept);
    // The arenas of threads take 64 MiB at a time; with a pad as large none would be given back.
    mallopt(M_TOP_PAD, kept / 4);
    mallopt(M_MMAP_THRESHOLD, 4 << 20); // setting the others fixes it at 128 KiB
#endif
}

} // namespace fraja
