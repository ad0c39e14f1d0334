// fraja-watch without a JOB: the tables of broker, jobs and workers.
#pragma once

#include "client/watch_options.hpp"
#include "common/net/signals.hpp"

namespace fraja::client {

/// Returns the exit code.
[[nodiscard]] int watch_farm(const WatchOptions& options, Console& console,
                             const net::SignalWatch* signals);

} // namespace fraja::client
