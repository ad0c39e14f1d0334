// Drawer: whom a tile is of, where it matters whom to believe.
#pragma once

#include "broker/events.hpp"
#include "common/base/ids.hpp"

#include <string>

namespace fraja::broker {

/// Whom the tiles of a worker are of, for every broker and after every start: its key, where it
/// has come with one of its own (a UUID of version 8, made of that key), or else itself. So nobody
/// is another one by a new name or a new process, but where many machines share a key.
[[nodiscard]] WorkerId drawer_of(const WorkerId& worker, const Holder& holder);

/// Who has one voice where answers are compared: all who have the drawer's key; where there are no
/// keys, or one for many machines, all workers of one name, as a process that was started anew
/// agrees with itself.
[[nodiscard]] std::string voter_of(const WorkerId& drawer, const std::string& worker_name);

} // namespace fraja::broker
