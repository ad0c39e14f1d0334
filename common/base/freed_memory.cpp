#include "common/base/freed_memory.hpp"

#include <cstdlib>
#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace fraja {

void keep_freed_memory([[maybe_unused]] std::size_t bytes) {
#ifdef __GLIBC__
    const int kept = static_cast<int>(bytes);
    mallopt(M_TRIM_THRESHOLD, kept);
    mallopt(M_TOP_PAD, kept);
    mallopt(M_MMAP_THRESHOLD, kept / 16); // setting the others fixes it at 128 KiB
#endif
}

} // namespace fraja
