// fraja-submit --travel: a film, each frame a job of its own; many at a time, so that every machine
// has one.
#pragma once

#include "client/submit_options.hpp"
#include "common/net/signals.hpp"

namespace fraja::client {

/// Returns the exit code. `signals` may be null.
[[nodiscard]] int run_submit_film(const SubmitOptions& options, const net::SignalWatch* signals);

} // namespace fraja::client
