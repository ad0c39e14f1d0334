// fraja-watch JOB: its tiles as they finish, and its picture.
#pragma once

#include "client/watch_options.hpp"
#include "common/net/signals.hpp"

namespace fraja::client {

/// Returns the exit code.
[[nodiscard]] int watch_job(const WatchOptions& options, Console& console,
                            const net::SignalWatch* signals);

} // namespace fraja::client
