// fraja-worker: reads the options and runs the worker.
#include "common/base/freed_memory.hpp"
#include "common/base/guarded.hpp"
#include "common/base/resident_memory.hpp"
#include "common/base/text.hpp"
#include "common/base/version.hpp"
#include "common/cli/parse.hpp"
#include "common/net/clock.hpp"
#include "common/net/endpoint.hpp"
#include "common/net/signals.hpp"
#include "common/render/kernel/render.hpp"
#include "common/service/logger.hpp"
#include "common/service/notifier.hpp"
#include "worker/duty.hpp"
#include "worker/shell.hpp"

#include <CLI/CLI.hpp>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <exception>
#include <fmt/core.h>
#include <optional>
#include <string>
#include <sys/resource.h>
#include <system_error>
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

enum Exit : int { done = 0, refused = 4, start_again = 75, interrupted = 128 };

struct Arguments {
    worker::WorkerOptions options;
    worker::DutyTerms duty;
    std::optional<worker::Hours> hours;
    std::vector<std::string> emulate;
    std::string hours_text, idle_exit, max_memory;
    int niceness = 0;
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
    app.add_option("--hours", arguments.hours_text,
                   "Serve in these hours of the day alone; otherwise rest, and come back")
        ->type_name("20:00-08:00");
    app.add_option("--idle-exit", arguments.idle_exit, "Leave after so long without a tile")
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
        arguments.duty.memory_max = *bytes;
    }
    return {};
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
    if (const auto read = read_duty(arguments); !read)
        return read.error();
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
        return fmt::format("'{}' serves with {} on {}", options.name,
                           counted(options.threads, "thread"), isa);
    std::string speeds;
    for (const worker::EmulatedWorkers& e : options.emulated)
        speeds +=
            fmt::format("{}{} of {:g} rays/s", speeds.empty() ? "" : ", ", e.count, e.rays_per_s);
    return fmt::format("'{}' EMULATES {} ({} and thread) with {} each: they answer "
                       "when it is time, and do not draw (but once for all, on {})",
                       options.name, counted(worker::emulated_count(options), "worker"), speeds,
                       counted(options.threads, "thread"), isa);
}

/// A process that serves: its worker, its hours, and whoever runs it.
class Service {
public:
    Service(Arguments& arguments, const net::SignalWatch& signals, std::string opening)
        : options_(arguments.options), hours_(arguments.hours), terms_(arguments.duty),
          signals_(signals), opening_(std::move(opening)), logger_(program, arguments.log) {
        options_.on_log = [this](const LogLine& line) { logger_.log(line); };
        options_.on_listening = [](const std::vector<std::string>& endpoints) {
            for (const std::string& endpoint : endpoints)
                fmt::print("listening {}\n", endpoint);
            std::fflush(stdout);
        };
        options_.on_turn = [this](const Load& load) { look_at(load); };
    }

    /// Until it has served enough; the exit code.
    int run() {
        if (const std::uint64_t now = resident_bytes();
            terms_.memory_max > 0 && terms_.memory_max <= now)
            return usage_error(fmt::format("--max-memory: a worker has {} MiB before it draws "
                                           "anything; give it more",
                                           now >> 20));
        tell(opening_);
        for (;;) {
            if (!wait_for_hours())
                return Exit::done; // told to leave while nothing was at hand
            const auto outcome = serve();
            if (!outcome)
                return fail(outcome.error().message);
            if (signal_count_ > 0 || *outcome != worker::FinishReason::drained)
                return exit_code(*outcome, last_signal_);
            if (verdict_ != worker::Duty::Verdict::go_on)
                return verdict_ == worker::Duty::Verdict::enough ? Exit::done : Exit::start_again;
        }
    }

private:
    using Load = worker::Load;

    void tell(const std::string& text) { logger_.log({LogLevel::info, {}, {}, text}); }
    [[nodiscard]] bool on_duty() const { return !hours_ || hours_->contains(worker::minute_now()); }

    /// From the worker's thread, about once a second.
    void look_at(const Load& load) {
        if (!std::exchange(is_ready_, true))
            notifier_.ready(opening_);
        notifier_.alive(net::now());
        logger_.tell_due();
        if (leaving_ || signal_count_ > 0)
            return;
        const std::uint64_t resident = terms_.memory_max > 0 ? resident_bytes() : 0;
        verdict_ = duty_.judge(net::now(), load, resident);
        if (verdict_ == worker::Duty::Verdict::go_on)
            return;
        leave(verdict_ == worker::Duty::Verdict::enough
                  ? "has served enough"
                  : fmt::format("has grown to {} MiB: leaves to be started again", resident >> 20));
    }

    /// Finishes the tiles at hand first.
    void leave(const std::string& why) {
        leaving_ = true;
        tell(why);
        notifier_.stopping(why);
        control_->drain();
    }

    /// Whether they have come; not where a signal came first.
    bool wait_for_hours() {
        for (bool told = false; !on_duty(); told = true) {
            const std::string text = "rests until " + worker::time_of_day(hours_->begin_min);
            if (!told) {
                tell(text);
                is_ready_ ? notifier_.status(text) : notifier_.ready(text);
                is_ready_ = true;
            }
            notifier_.alive(net::now());
            net::wait({signals_.fd()}, std::chrono::seconds(1));
            if (signals_.receive())
                return false;
            if (on_duty()) {
                tell("serves again");
                notifier_.status(opening_);
            }
        }
        return true;
    }

    /// Runs the worker in a thread of its own while this one watches signals and hours.
    Result<worker::FinishReason> serve() {
        control_.emplace();
        duty_ = worker::Duty(terms_); // a rest is no idleness
        leaving_ = false;
        const net::Waker woken;
        std::atomic<bool> ended = false;
        std::optional<Result<worker::FinishReason>> outcome;
        std::jthread thread([&] {
            outcome = guarded([&] { return worker::run_worker(context_, options_, *control_); });
            ended = true;
            woken.wake();
        });
        while (!ended) {
            net::wait({woken.fd(), signals_.fd()}, std::chrono::seconds(hours_ ? 1 : 60));
            take_signals();
            if (!on_duty() && !leaving_.exchange(true)) {
                tell("its hours are over");
                control_->drain();
            }
        }
        thread.join();
        return *outcome;
    }

    void take_signals() {
        while (const auto signal = signals_.receive()) {
            last_signal_ = *signal;
            if (++signal_count_ == 1) {
                notifier_.stopping("finishes the tiles at hand");
                control_->drain();
            } else {
                notifier_.stopping("hands back the tiles at hand");
                control_->stop_now();
            }
        }
    }

    worker::WorkerOptions& options_;
    const std::optional<worker::Hours> hours_;
    const worker::DutyTerms terms_;
    worker::Duty duty_{terms_}; ///< of the worker that serves now
    const net::SignalWatch& signals_;
    const std::string opening_;
    service::Logger logger_;
    service::Notifier notifier_;
    const net::Context context_;
    std::optional<worker::Control> control_; ///< of the worker that serves now
    bool is_ready_ = false;
    std::atomic<bool> leaving_ = false;
    worker::Duty::Verdict verdict_ = worker::Duty::Verdict::go_on;
    std::atomic<int> signal_count_ = 0;
    int last_signal_ = 0;
};

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
    const auto isa = kernel::instruction_set();
    if (!isa)
        return fail(isa.error().message);

    if (arguments.niceness > getpriority(PRIO_PROCESS, 0) && // whoever started it may know better
        setpriority(PRIO_PROCESS, 0, arguments.niceness) != 0)
        return fail("--nice: " + std::error_code(errno, std::generic_category()).message());
    return Service(arguments, signals, opening_line(options, *isa)).run();
} catch (const std::exception& e) {
    fmt::print(stderr, "fraja-worker: {}\n", e.what());
    return 1;
}
