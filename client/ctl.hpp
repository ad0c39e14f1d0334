// fraja-ctl, without its command line.
#pragma once

#include "client/ctl_options.hpp"
#include "common/net/signals.hpp"

namespace fraja::client {

/// Returns the exit code. `signals` may be null.
[[nodiscard]] int run_ctl(const CtlOptions& options, const net::SignalWatch* signals);

} // namespace fraja::client
