// fraja-worker: reads the options and runs the worker.
#include "common/base/freed_memory.hpp"
#include "common/base/guarded.hpp"
#include "common/base/version.hpp"
#include "common/cli/parse.hpp"
#include "common/net/clock.hpp"
#include "common/net/endpoint.hpp"
#include "common/net/signals.hpp"
#include "common/render/kernel/render.hpp"
#include "common/service/logger.hpp"
#include "common/service/notifier.hpp"
#include "worker/shell.hpp"

#include <CLI/CLI.hpp>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <exception>
#include <fmt/core.h>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace {

using namespace fraja;

constexpr const char* program = "fraja-worker";
constexpr const char* examples = R"(Examples:
  fraja-worker                                   serve the broker on this machine with every CPU
  fraja-worker -b tcp://farm.example:50057 -j 8  serve another machine's, with eight threads
  fraja-worker -b tcp://a:50057,tcp://b:50057    serve two brokers
  fraja-worker --listen tcp://127.0.0.1:0        wait for fraja-submit --direct; the port is printed
  fraja-worker --emulate 16@3k --emulate 16@6k   look like 32 machines of two speeds, to try a broker

Renders tiles for brokers until it is told to leave: the first TERM or INT finishes the tiles at
hand, a second one hands them back at once. A lost broker is greeted again for ever.
With --listen it serves one fraja-submit --direct after the other; the others wait for their turn.
FRAJA_ISA=x86-64-v2 (-v3, -v4) forces an instruction set; it never changes pixels.
)";

constexpr const char* no_isa = "no instruction set to render with";

enum Exit : int { done = 0, refused = 4, interrupted = 128 };

struct Arguments {
    worker::WorkerOptions options;
    std::vector<std::string> emulate;
    service::LogOptions log;
};

int usage_error(const std::string& message) {
    return cli::leave(cli::usage_error(program, message));
}

int fail(const std::string& message) {
    return cli::leave(cli::failure(program, message));
}

void describe(CLI::App& app, Arguments& arguments) {
    worker::WorkerOptions& options = arguments.options;
    app.set_version_flag("--version",
                         version_line(program, kernel::instruction_set().value_or(no_isa)));
    CLI::Option* const broker =
        app.add_option("-b,--broker", options.brokers,
                       "Broker to serve, tcp://HOST:PORT; several, or a comma list: all of them")
            ->envname("FRAJA_BROKER")
            ->delimiter(',')
            ->default_str(net::default_broker)
            ->type_name("ENDPOINT");
    const auto listen = [&options, broker](const std::string& endpoint) {
        options.listen = endpoint;
        broker->envname("")->configurable(
            false); // a broker that is set is for workers that want one
    };
    app.add_option_function<std::string>(
           "--listen", listen,
           "Instead of connecting to a broker, wait here to be called by fraja-submit --direct; "
           "port 0: the system chooses; where is printed. With --emulate, each worker has a port: "
           "this one and those that follow, or, of 0, what the system chooses")
        ->type_name("tcp://HOST:PORT")
        ->trigger_on_parse();
    app.add_flag("--insecure", options.insecure,
                 "Listen at addresses that other machines reach, without keys");
    app.add_option("-j,--threads", options.threads, "Render threads")
        ->default_str("every CPU this process may use")
        ->check(CLI::Range(1u, worker::threads_max))
        ->type_name("N");
    app.add_option("--name", options.name, "What people see this worker called")
        ->default_str("HOST:PID")
        ->type_name("NAME");
    app.add_option("--tag", options.tags, "K or K=V, for jobs that ask for it; repeatable")
        ->allow_extra_args(false)
        ->type_name("K[=V]");
    app.add_option("--emulate", arguments.emulate,
                   "For benchmarks: COUNT workers that answer with true pixels when a machine of "
                   "SPEED rays per second and thread (3500, 3.5k, 2M) would, without its work; "
                   "the first tile of a picture has all of it drawn here. One thread each, or -j "
                   "N; repeatable")
        ->type_name("COUNT@SPEED")
        ->allow_extra_args(false);
    service::add_log_options(app, arguments.log);
}

/// Endpoints as sockets take them, and what is emulated.
Result<void> complete(Arguments& arguments, bool threads_given) {
    worker::WorkerOptions& options = arguments.options;
    for (const std::string& text : arguments.emulate) {
        const auto workers = worker::parse_emulated_workers(text);
        if (!workers)
            return workers.error();
        options.emulated.push_back(*workers);
    }
    if (!options.emulated.empty() && !threads_given)
        options.threads = 1;
    if (options.brokers.empty() && options.listen.empty())
        options.brokers = {net::default_broker};
    for (std::string& broker : options.brokers) {
        if (broker == "auto")
            return Error{ErrorCode::invalid_argument,
                         "--broker auto: this version does not discover brokers; name one"};
        const auto endpoint = net::endpoint_to_connect(broker, net::broker_port);
        if (!endpoint)
            return Error{endpoint.error().code, "--broker: " + endpoint.error().message};
        broker = *endpoint;
    }
    return worker::validate(options);
}

int exit_code(worker::FinishReason reason, int last_signal) {
    switch (reason) {
    case worker::FinishReason::drained:
    case worker::FinishReason::dismissed:
        return Exit::done;
    case worker::FinishReason::stopped:
        return Exit::interrupted + last_signal;
    case worker::FinishReason::version_mismatch:
        return Exit::refused;
    }
    return Exit::done;
}

std::string opening_line(const worker::WorkerOptions& options, const std::string& isa) {
    if (options.emulated.empty())
        return fmt::format("'{}' serves with {} threads on {}", options.name, options.threads, isa);
    std::string speeds;
    for (const worker::EmulatedWorkers& e : options.emulated)
        speeds +=
            fmt::format("{}{} of {:g} rays/s", speeds.empty() ? "" : ", ", e.count, e.rays_per_s);
    return fmt::format("'{}' EMULATES {} workers ({} and thread) with {} threads each: they answer "
                       "when it is time, and do not draw (but once for all, on {})",
                       options.name, worker::emulated_count(options), speeds, options.threads, isa);
}

/// Runs the worker in a thread of its own while this one watches the signals.
int serve(const worker::WorkerOptions& options, const net::SignalWatch& signals,
          const service::Notifier& notifier) {
    const net::Context context;
    worker::Control control;
    const net::Waker woken;
    std::atomic<bool> ended = false;
    std::optional<Result<worker::FinishReason>> outcome;
    std::jthread thread([&] {
        outcome = guarded([&] { return worker::run_worker(context, options, control); });
        ended = true;
        woken.wake();
    });
    int signal_count = 0, last_signal = 0;
    while (!ended) {
        net::wait({woken.fd(), signals.fd()}, std::chrono::minutes(1));
        while (const auto signal = signals.receive()) {
            last_signal = *signal;
            if (++signal_count == 1) {
                notifier.stopping("finishes the tiles at hand");
                control.drain();
            } else {
                notifier.stopping("hands back the tiles at hand");
                control.stop_now();
            }
        }
    }
    thread.join();
    if (!*outcome)
        return fail(outcome->error().message);
    return exit_code(**outcome, last_signal);
}

} // namespace

int main(int argc, char** argv) try {
    keep_freed_memory(std::size_t{32} << 20); // tiles; scenes are larger, and may go
    const net::SignalWatch signals({SIGINT, SIGTERM});
    Arguments arguments;
    arguments.options.threads = worker::usable_cpu_count();
    arguments.options.name = worker::default_worker_name();
    CLI::App app(examples, program);
    describe(app, arguments);
    if (const auto early = cli::parse(app, cli::arguments_of(argc, argv)))
        return cli::leave(*early);
    worker::WorkerOptions& options = arguments.options;
    if (const auto completed = complete(arguments, app.count("--threads") > 0); !completed)
        return usage_error(completed.error().message);
    const auto isa = kernel::instruction_set();
    if (!isa)
        return fail(isa.error().message);

    options.on_listening = [](const std::vector<std::string>& endpoints) {
        for (const std::string& endpoint : endpoints)
            fmt::print("listening {}\n", endpoint);
        std::fflush(stdout);
    };
    service::Logger logger(program, arguments.log);
    service::Notifier notifier;
    const std::string opening = opening_line(options, *isa);
    options.on_log = [&](const LogLine& line) { logger.log(line); };
    options.on_turn = [&, is_ready = false]() mutable {
        if (!std::exchange(is_ready, true))
            notifier.ready(opening);
        notifier.alive(net::now());
        logger.tell_due();
    };
    logger.log({LogLevel::info, {}, {}, opening});
    return serve(options, signals, notifier);
} catch (const std::exception& e) {
    fmt::print(stderr, "fraja-worker: {}\n", e.what());
    return 1;
}
