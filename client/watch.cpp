#include "client/watch.hpp"

#include "client/watch_farm.hpp"
#include "client/watch_job.hpp"

namespace fraja::client {

int run_watch(const WatchOptions& options, const net::SignalWatch* signals) {
    Console console(options.shared.console);
    return options.job ? watch_job(options, console, signals)
                       : watch_farm(options, console, signals);
}

} // namespace fraja::client
