// For programs through which much memory goes in pieces.
#pragma once

#include <cstddef>

namespace fraja {

/// From now on malloc keeps up to about so much of what is freed, in each of its arenas, for what
/// comes next, and takes a quarter of it at once of the system; only from 4 MiB on a piece is a
/// mapping of its own. By itself it gives memory back as soon as 128 KiB are free, and of every few
/// tiles that go through a thread, the pages are fetched and cleared anew.
void keep_freed_memory(std::size_t bytes = std::size_t{64} << 20);

} // namespace fraja
