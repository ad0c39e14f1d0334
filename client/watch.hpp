// fraja-watch, without its command line.
#pragma once

#include "client/watch_options.hpp"
#include "common/net/signals.hpp"

namespace fraja::client {

/// Returns the exit code. `signals` may be null.
[[nodiscard]] int run_watch(const WatchOptions& options, const net::SignalWatch* signals);

} // namespace fraja::client
