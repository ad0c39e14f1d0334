// fraja-submit: submits a scene, follows it, writes the picture.
#include "client/submit.hpp"
#include "common/base/freed_memory.hpp"

#include <csignal>
#include <cstdio>
#include <exception>

int main(int argc, char** argv) try {
    using namespace fraja;
    keep_freed_memory(client::kept_freed_bytes);
    const net::SignalWatch signals({SIGINT, SIGTERM});
    const auto parsed = client::parse_submit_options(cli::arguments_of(argc, argv));
    if (const auto* early = std::get_if<cli::EarlyExit>(&parsed))
        return cli::leave(*early);
    return client::run_submit(std::get<client::SubmitOptions>(parsed), &signals);
} catch (const std::exception& e) {
    std::fprintf(stderr, "fraja-submit: %s\n", e.what());
    return 1;
}
