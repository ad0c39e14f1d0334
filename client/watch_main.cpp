// fraja-watch: shows a job's tiles as they finish, or the farm.
#include "client/watch.hpp"
#include "common/base/freed_memory.hpp"

#include <csignal>
#include <cstdio>
#include <exception>

int main(int argc, char** argv) try {
    using namespace fraja;
    keep_freed_memory(client::kept_freed_bytes);
    const net::SignalWatch signals({SIGINT, SIGTERM});
    const auto parsed = client::parse_watch_options(cli::arguments_of(argc, argv));
    if (const auto* early = std::get_if<cli::EarlyExit>(&parsed))
        return cli::leave(*early);
    return client::run_watch(std::get<client::WatchOptions>(parsed), &signals);
} catch (const std::exception& e) {
    std::fprintf(stderr, "fraja-watch: %s\n", e.what());
    return 1;
}
