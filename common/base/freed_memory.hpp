// For programs through which much memory goes in pieces.
#pragma once

namespace fraja {

/// From now on malloc keeps up to 64 MiB of what is freed for what comes next, and takes as much at
/// once of the system. By itself it gives memory back as soon as 128 KiB are free, and of every
/// few tiles that go through a thread, the pages are fetched and cleared anew.
void keep_freed_memory();

} // namespace fraja
