#include "common/base/freed_memory.hpp"

#include <cstdlib>
#ifdef __GLIBC__
#include <malloc.h>
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

} // namespace fraja
