#include "common/base/freed_memory.hpp"

#include "common/base/assert.hpp"

#include <cstdlib>
#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace fraja {
namespace {

/// Of addresses, which an arena of a thread takes at a time.
constexpr std::size_t arena_part_bytes = std::size_t{64} << 20;

void set_malloc([[maybe_unused]] std::size_t kept_bytes, [[maybe_unused]] std::size_t pad_bytes) {
#ifdef __GLIBC__
    mallopt(M_TRIM_THRESHOLD, static_cast<int>(kept_bytes));
    mallopt(M_TOP_PAD, static_cast<int>(pad_bytes));
    mallopt(M_MMAP_THRESHOLD, 4 << 20); // setting the others fixes it at 128 KiB
#endif
}

} // namespace

void keep_freed_memory(std::size_t bytes) {
    FRAJA_ASSERT(bytes < arena_part_bytes);
    set_malloc(bytes, bytes / 4);
}

void keep_all_freed_memory() {
    set_malloc(arena_part_bytes, arena_part_bytes); // with such a pad no part seems to be to spare
}

void give_back_freed_memory() {
#ifdef __GLIBC__
    malloc_trim(0);
#endif
}

} // namespace fraja
