// fraja-broker: reads the options and runs the broker.
#include "broker/shell.hpp"
#include "common/base/text.hpp"
#include "common/base/version.hpp"

#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fmt/core.h>
#include <iostream>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <string>

namespace {

using namespace fraja;

constexpr const char* examples = R"(Examples:
  fraja-broker                                   a broker for this machine
  fraja-broker --bind tcp://127.0.0.1:0          on a port the system chooses; it is printed
  fraja-broker --bind 'tcp://*:50057' --publish 'tcp://*:50058' --insecure
                                                 for a network you trust

Deals out the tiles of submitted pictures to workers and publishes them as they finish.
)";

struct Arguments {
    broker::Options options;
    std::string state; ///< empty: the default, where there can be one
    std::string heartbeat = "1s", lease = "60s", log_level = "info";
};

/// $XDG_STATE_HOME/fraja, or what the XDG specification puts in its place.
std::string default_state() {
    if (const char* state = std::getenv("XDG_STATE_HOME"); state && *state)
        return std::string(state) + "/fraja";
    if (const char* home = std::getenv("HOME"); home && *home)
        return std::string(home) + "/.local/state/fraja";
    return "none";
}

int usage_error(const std::string& message) {
    fmt::print(stderr, "fraja-broker: {}\n", message);
    return 2;
}

Result<void> prepare_state(const std::string& state) {
    if (state == "none")
        return {};
    std::error_code error;
    std::filesystem::create_directories(state, error);
    if (error || !std::filesystem::is_directory(state))
        return Error{ErrorCode::io, "--state " + state + ": cannot make this directory: " +
                                        (error ? error.message() : "something else is there")};
    return {};
}

spdlog::level::level_enum to_spdlog(broker::LogLevel level) {
    switch (level) {
    case broker::LogLevel::debug:
        return spdlog::level::debug;
    case broker::LogLevel::info:
        return spdlog::level::info;
    case broker::LogLevel::warning:
        return spdlog::level::warn;
    case broker::LogLevel::error:
        return spdlog::level::err;
    }
    return spdlog::level::info;
}

void add_options(CLI::App& app, Arguments& arguments) {
    broker::Options& options = arguments.options;
    app.set_version_flag("--version", version_line("fraja-broker"));
    app.add_option("--bind", options.bind,
                   "Where workers and clients connect; port 0: the system chooses")
        ->envname("FRAJA_BIND")
        ->capture_default_str();
    app.add_option("--publish", options.publish, "Where the stream of tiles is published")
        ->envname("FRAJA_PUBLISH")
        ->capture_default_str();
    app.add_option(
           "--state", arguments.state,
           "Directory for jobs and tiles, or 'none'. This version keeps them in memory only: "
           "the directory is made and checked, jobs end with the broker")
        ->default_str("$XDG_STATE_HOME/fraja");
    app.add_flag("--insecure", options.insecure,
                 "Serve addresses that other machines reach, without keys");
    app.add_option("--heartbeat", arguments.heartbeat, "Time between two signs of life")
        ->capture_default_str();
    app.add_option("--liveness", options.limits.liveness, "Beats that a worker or client may miss")
        ->capture_default_str()
        ->check(CLI::Range(1, 1000));
    app.add_option("--lease", arguments.lease,
                   "A tile that traces no ray for so long is given to another worker")
        ->capture_default_str();
    app.add_option(
           "--max-attempts", options.limits.attempts_max,
           "Failures of one tile, on different workers where there are, before its job fails")
        ->capture_default_str()
        ->check(CLI::Range(1, 1000));
    app.add_option("--log-level", arguments.log_level, "debug, info, warning or error")
        ->capture_default_str()
        ->check(CLI::IsMember({"debug", "info", "warning", "error"}));
}

} // namespace

int main(int argc, char** argv) {
    const net::SignalWatch signals({SIGINT, SIGTERM, SIGHUP, SIGUSR1});
    Arguments arguments;
    CLI::App app(examples);
    add_options(app, arguments);
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& e) {
        return app.exit(e) == 0 ? 0 : 2;
    }

    broker::Options& options = arguments.options;
    const auto heartbeat = parse_duration(arguments.heartbeat),
               lease = parse_duration(arguments.lease);
    if (!heartbeat || *heartbeat < std::chrono::milliseconds(10))
        return usage_error("--heartbeat " + arguments.heartbeat +
                           ": a duration of at least 10ms, as 1s");
    if (!lease || *lease < *heartbeat)
        return usage_error("--lease " + arguments.lease +
                           ": a duration not below the heartbeat, as 60s");
    options.limits.heartbeat = *heartbeat;
    options.limits.lease = *lease;
    const bool default_wanted = arguments.state.empty();
    if (default_wanted)
        arguments.state = default_state();
    std::string state_warning;
    if (const auto prepared = prepare_state(arguments.state); !prepared && !default_wanted)
        return usage_error(prepared.error().message);
    else if (!prepared)
        state_warning = prepared.error().message;

    const auto logger = spdlog::stderr_color_mt("fraja-broker");
    logger->set_pattern("%Y-%m-%d %H:%M:%S.%e %n %^%l%$ %v");
    logger->set_level(spdlog::level::from_str(arguments.log_level));
    options.signals = &signals;
    options.on_log = [&](broker::LogLevel level, const std::string& text) {
        logger->log(to_spdlog(level), "{}", text);
    };
    options.on_listening = [&](const std::string& bound, const std::string& stream) {
        fmt::print("listening {} stream {}\n", bound, stream);
        std::fflush(stdout);
        if (!state_warning.empty())
            logger->warn("{}", state_warning);
        if (arguments.state != "none")
            logger->info("jobs are kept in memory only: they end with this process");
    };

    const net::Context context;
    const broker::Control control;
    const auto ran = broker::run_broker(context, options, control);
    if (!ran)
        return usage_error(ran.error().message);
    return 0;
}
