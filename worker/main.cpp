// fraja-worker: reads the options and runs the worker.
#include "common/base/allowance.hpp"
#include "common/base/freed_memory.hpp"
#include "common/base/resident_memory.hpp"
#include "common/base/text.hpp"
#include "common/base/version.hpp"
#include "common/cli/parse.hpp"
#include "common/discovery/source.hpp"
#include "common/net/endpoint.hpp"
#include "common/net/signals.hpp"
#include "common/render/kernel/render.hpp"
#include "common/service/key_options.hpp"
#include "common/service/log_options.hpp"
#include "worker/duty.hpp"
#include "worker/service.hpp"

#include <CLI/CLI.hpp>
#include <cerrno>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <fmt/core.h>
#include <optional>
#include <string>
#include <sys/resource.h>
#include <system_error>
#include <utility>
#include <vector>

namespace {

using namespace fraja;

constexpr const char* program = "fraja-worker";
constexpr const char* examples = R"(Examples:
  fraja-worker                                   serve the broker on this machine with every CPU
  fraja-worker -b tcp://farm.example:50057 -j 8  serve another machine's, with eight threads
  fraja-worker -b tcp://a:50057,tcp://b:50057    serve two brokers
  fraja-worker -b auto --key-file worker.key     serve the own farm's, wherever on this network
  fraja-worker --listen tcp://127.0.0.1:0        wait for fraja-submit --direct; the port is printed
  fraja-worker --emulate 16@3k --emulate 16@6k   look like 32 machines of two speeds, to try a broker

Renders tiles for brokers until it is told to leave: the first TERM or INT finishes the tiles at
hand, a second one hands them back at once. A lost broker is greeted again for ever; those that
stand for it (fraja-broker --peer) are served as well: naming one of them is enough.
With --listen it serves one fraja-submit --direct after the other; the others wait for their turn.
FRAJA_ISA=x86-64-v2 (-v3, -v4) forces an instruction set; it never changes pixels.
)";

constexpr const char* no_isa = "no instruction set to render with";

struct Arguments {
    worker::WorkerOptions options;
    worker::DutyTerms duty;
    std::optional<worker::Hours> hours;
    std::vector<std::string> emulate;
    std::string hours_text, idle_exit, max_memory;
    std::string threads_because, warning; ///< for its first words
    std::string alive_file;
    int niceness = 0;
    service::KeyOptions keys;
    service::LogOptions log;
};

int usage_error(const std::string& message) {
    return cli::leave(cli::usage_error(program, message));
}

int fail(const std::string& message) {
    return cli::leave(cli::failure(program, message));
}

int fail(const Error& error) {
    return cli::leave(cli::failure(program, error));
}

void describe(CLI::App& app, Arguments& arguments) {
    worker::WorkerOptions& options = arguments.options;
    app.set_version_flag("--version",
                         version_line(program, kernel::instruction_set().value_or(no_isa)));
    CLI::Option* const broker =
        app.add_option(
               "-b,--broker", options.brokers,
               "Broker to serve, tcp://HOST:PORT; several, or a comma list: all of them; auto: "
               "those that announce themselves on this network; srv:DOMAIN: those that the "
               "DNS names")
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
    service::add_key_options(app, arguments.keys,
                             "Public key of the broker (of all that --broker names)");
    app.add_option("--allow", options.allow,
                   "With --listen: whose keys may call, as of fraja-broker; those with the role "
                   "submit. Read again at HUP")
        ->type_name("FILE");
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
    app.add_option("--hours", arguments.hours_text,
                   "Serve in these hours of the day alone; otherwise rest, and come back")
        ->type_name("20:00-08:00");
    app.add_option("--idle-exit", arguments.idle_exit,
                   "Leave after so long without a tile; with exit 3 where no broker has "
                   "answered in all that time, with 4 where they refused")
        ->type_name("T");
    app.add_flag("--once", arguments.duty.once, "Leave when the first work is over");
    app.add_option("--max-memory", arguments.max_memory,
                   "Having grown beyond it, finish the tiles at hand and leave with exit 75, to be "
                   "started again")
        ->type_name("SIZE");
    app.add_option("--nice", arguments.niceness, "Of the machine's other work this one goes behind")
        ->check(CLI::Range(0, 19))
        ->default_str("0")
        ->type_name("N");
    app.add_option("--alive", arguments.alive_file,
                   "Write this file anew about every second, for whoever looks at its age and "
                   "starts workers again that hang")
        ->type_name("FILE");
    service::add_log_options(app, arguments.log);
}

Result<void> read_duty(Arguments& arguments) {
    if (!arguments.hours_text.empty()) {
        arguments.hours = worker::parse_hours(arguments.hours_text);
        if (!arguments.hours)
            return Error{ErrorCode::invalid_argument,
                         "--hours " + arguments.hours_text +
                             ": from a time to another, as 20:00-08:00"};
    }
    if (!arguments.idle_exit.empty()) {
        arguments.duty.idle_exit = parse_duration(arguments.idle_exit);
        if (!arguments.duty.idle_exit || *arguments.duty.idle_exit <= Duration::zero())
            return Error{ErrorCode::invalid_argument,
                         "--idle-exit " + arguments.idle_exit +
                             ": a time above 0 is written as 90s, 15m or 1h30m"};
    }
    if (!arguments.max_memory.empty()) {
        const auto bytes = parse_byte_size(arguments.max_memory);
        if (!bytes || *bytes == 0)
            return Error{ErrorCode::invalid_argument, "--max-memory " + arguments.max_memory +
                                                          ": a size is written as 512M or 4G"};
        if (const std::uint64_t now = resident_bytes(); *bytes <= now)
            return Error{ErrorCode::invalid_argument,
                         fmt::format("--max-memory: a worker has {} MiB before it draws anything; "
                                     "give it more",
                                     now >> 20)};
        arguments.duty.memory_max = *bytes;
    }
    return {};
}

/// What it may have of the machine, where that is less than all.
void look_at_allowance(Arguments& arguments, bool threads_given) {
    worker::WorkerOptions& options = arguments.options;
    if (!threads_given)
        arguments.threads_because = usable_processors().limit;
    worker::MemoryShare memory =
        worker::memory_share(arguments.duty.memory_max, memory_limit(read_system_file));
    options.memory_bytes = memory.bytes;
    arguments.warning = std::move(memory.warning);
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
    auto brokers = discovery::broker_words(options.brokers);
    if (!brokers)
        return Error{brokers.error().code, "--broker: " + brokers.error().message};
    options.brokers = *std::move(brokers);
    if (!options.allow.empty() && arguments.keys.file.empty())
        return Error{ErrorCode::invalid_argument,
                     "--allow is of no use without a key of this worker's own: --key-file FILE"};
    if (!options.listen.empty() && !arguments.keys.file.empty() && options.allow.empty())
        return Error{ErrorCode::invalid_argument,
                     "--key-file: who may call this worker? --allow FILE says it"};
    if (const auto read = read_duty(arguments); !read)
        return read.error();
    return worker::validate(options);
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
    cli::Origins origins;
    if (const auto early = cli::parse(app, cli::arguments_of(argc, argv), origins))
        return cli::leave(*early);
    worker::WorkerOptions& options = arguments.options;
    if (const auto completed = complete(arguments, app.count("--threads") > 0); !completed)
        return usage_error(origins.blame(completed.error().message));
    look_at_allowance(arguments, app.count("--threads") > 0);
    auto keys = service::read_keys(arguments.keys, !options.listen.empty());
    if (!keys)
        return usage_error(origins.blame(keys.error().message));
    const auto isa = kernel::instruction_set();
    if (!isa)
        return fail(isa.error().message);

    if (arguments.niceness > getpriority(PRIO_PROCESS, 0) && // whoever started it may know better
        setpriority(PRIO_PROCESS, 0, arguments.niceness) != 0)
        return fail("--nice: " + std::error_code(errno, std::generic_category()).message());
    std::optional<net::SignalWatch> hangups;
    if (!options.allow.empty())
        hangups.emplace(std::initializer_list<int>{SIGHUP});
    const auto code = worker::Service({.program = program,
                                       .worker = std::move(options),
                                       .keys = *std::move(keys),
                                       .duty = arguments.duty,
                                       .hours = arguments.hours,
                                       .log = arguments.log,
                                       .isa = *isa,
                                       .threads_because = arguments.threads_because,
                                       .warning = arguments.warning,
                                       .alive_file = arguments.alive_file,
                                       .hangups = hangups ? &*hangups : nullptr},
                                      signals)
                          .run();
    return code ? *code : fail(code.error());
} catch (const std::exception& e) {
    fmt::print(stderr, "fraja-worker: {}\n", e.what());
    return 1;
}
