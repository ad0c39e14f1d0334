// fraja-watch --serve: the live page.
#pragma once

#include "client/watch_options.hpp"
#include "common/net/signals.hpp"

namespace fraja::client {

/// Serves until a signal comes or the broker refuses; returns the exit code. The options say
/// `serve`. `signals` may be null.
[[nodiscard]] int run_page(const WatchOptions& options, const net::SignalWatch* signals);

} // namespace fraja::client
