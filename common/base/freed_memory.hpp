// For programs through which much memory goes in pieces: by itself malloc gives memory back to the
// system as soon as 128 KiB are free, and of every few tiles that go through a thread, the pages
// are fetched and cleared anew.
#pragma once

#include <cstddef>

namespace fraja {

/// From now on malloc keeps up to so much of what is freed, in each of its arenas, for what comes
/// next; of more, about a quarter of that. Less than 64 MiB (asserted): what an arena of a thread
/// takes at once.
void keep_freed_memory(std::size_t bytes);

/// All that threads free, however much that once was; of what the first one frees, 64 MiB.
void keep_all_freed_memory();

/// Gives back all that is kept, for once; what comes next fetches it anew. It takes up to 0.1 ms
/// for each MiB that was kept.
void give_back_freed_memory();

} // namespace fraja
