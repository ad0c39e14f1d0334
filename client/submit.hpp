// fraja-submit, without its command line: checks, submits, follows, writes, reports.
#pragma once

#include "client/submit_options.hpp"
#include "common/net/signals.hpp"

namespace fraja::client {

/// Returns the exit code. `signals` may be null.
[[nodiscard]] int run_submit(const SubmitOptions& options, const net::SignalWatch* signals);

} // namespace fraja::client
