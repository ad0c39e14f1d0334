// For programs through which much memory goes in pieces.
#pragma once

#include <cstdint>

namespace fraja {

/// From now on malloc keeps up to 64 MiB of what is freed for what comes next, and takes as much at
/// once of the system. By itself it gives memory back as soon as 128 KiB are free, and of every
/// few tiles that go through a thread, the pages are fetched and cleared anew.
void keep_freed_memory();

/// What malloc takes of the system for the main thread, from the construction on, is of huge pages
/// where the system has them for those who ask: whoever keeps pictures is interrupted once for
/// 2 MiB of them, and not six times for a tile.
class HugeHeapPages {
public:
    HugeHeapPages();
    /// To be called once in a while, by that thread: it costs nothing while the heap has not grown.
    void ask_for_growth();

private:
    std::uintptr_t asked_until_;
};

} // namespace fraja
