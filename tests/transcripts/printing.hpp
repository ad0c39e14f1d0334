// Actions of the broker's core, each as a line of a transcript.
#pragma once

#include "broker/events.hpp"

#include <string>

namespace fraja::broker {

/// "send a RenderTile job=1 tile=0 attempt=1 ...": every field of the message by its own name, in
/// the order of the wire. Fields that are as in a new message are left out, but for what tells what
/// happened (phases, codes, tiles). Ids are short, bytes are counted, and nothing depends on when
/// and where it was compiled.
[[nodiscard]] std::string printed(const Action& action);

/// "250ms", "3.031s": exactly.
[[nodiscard]] std::string printed(Duration d);

} // namespace fraja::broker
