// fraja-ctl: looks after jobs and workers.
#include "client/ctl.hpp"

#include <csignal>
#include <cstdio>
#include <exception>

int main(int argc, char** argv) try {
    using namespace fraja;
    const net::SignalWatch signals({SIGINT, SIGTERM});
    const auto parsed = client::parse_ctl_options(cli::arguments_of(argc, argv));
    if (const auto* early = std::get_if<cli::EarlyExit>(&parsed))
        return cli::leave(*early);
    return client::run_ctl(std::get<client::CtlOptions>(parsed), &signals);
} catch (const std::exception& e) {
    std::fprintf(stderr, "fraja-ctl: %s\n", e.what());
    return 1;
}
