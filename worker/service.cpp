#include "worker/service.hpp"

#include "common/base/guarded.hpp"
#include "common/base/resident_memory.hpp"
#include "common/base/text.hpp"
#include "common/net/clock.hpp"

#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <fmt/core.h>
#include <fstream>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

namespace fraja::worker {
namespace {

enum Exit : int { done = 0, no_broker = 3, refused = 4, start_again = 75, interrupted = 128 };

int exit_code(FinishReason reason, int last_signal) {
    switch (reason) {
    case FinishReason::drained:
    case FinishReason::dismissed:
        return Exit::done;
    case FinishReason::stopped:
        return Exit::interrupted + last_signal;
    case FinishReason::version_mismatch:
        return Exit::refused;
    }
    return Exit::done;
}

/// Of a worker that has waited for work for long enough. One that is called may have had no caller.
int exit_code(Reception reception, bool is_called) {
    if (is_called || reception == Reception::welcomed)
        return Exit::done;
    return reception == Reception::refused ? Exit::refused : Exit::no_broker;
}

std::string why_it_leaves(Reception reception, bool is_called) {
    switch (exit_code(reception, is_called)) {
    case Exit::refused:
        return "has waited long enough (--idle-exit), and every broker has refused it";
    case Exit::no_broker:
        return "has waited long enough (--idle-exit), and no broker has answered";
    default:
        return "has served enough (--once, --idle-exit)";
    }
}

std::string opening_line(const ServiceOptions& service) {
    const WorkerOptions& options = service.worker;
    const std::string& isa = service.isa;
    if (options.emulated.empty())
        return fmt::format(
            "'{}' serves with {} on {}{}", options.name, counted(options.threads, "thread"), isa,
            service.threads_because.empty() ? "" : " (" + service.threads_because + ")");
    std::string speeds;
    for (const EmulatedWorkers& e : options.emulated)
        speeds +=
            fmt::format("{}{} of {:g} rays/s", speeds.empty() ? "" : ", ", e.count, e.rays_per_s);
    return fmt::format("'{}' EMULATES {} ({} and thread) with {} each: they answer "
                       "when it is time, and do not draw (but once for all, on {})",
                       options.name, counted(emulated_count(options), "worker"), speeds,
                       counted(options.threads, "thread"), isa);
}

} // namespace

Service::Service(ServiceOptions options, const net::SignalWatch& signals)
    : options_(std::move(options)), signals_(signals), opening_(opening_line(options_)),
      logger_(options_.program, options_.log), context_(std::move(options_.keys)),
      duty_(options_.duty) {
    options_.worker.on_log = [this](const LogLine& line) { logger_.log(line); };
    options_.worker.on_listening = [this](const std::vector<std::string>& endpoints) {
        open(); // not before it is known that it can
        for (const std::string& endpoint : endpoints)
            fmt::print("listening {}\n", endpoint);
        std::fflush(stdout);
    };
    options_.worker.on_turn = [this](const Load& load) { look_at(load); };
}

Result<int> Service::run() {
    if (!show_life())
        return Error{ErrorCode::io, "--alive " + options_.alive_file +
                                        ": no file can be written there: " +
                                        std::generic_category().message(errno)};
    if (options_.worker.listen.empty())
        open();
    for (;;) {
        if (!wait_for_hours())
            return Exit::done; // told to leave while nothing was at hand
        const auto outcome = serve();
        if (!outcome)
            return outcome.error();
        if (signal_count_ > 0 || *outcome != FinishReason::drained)
            return exit_code(*outcome, last_signal_);
        if (verdict_ != Duty::Verdict::go_on)
            return verdict_ == Duty::Verdict::enough
                       ? exit_code(reception_, !options_.worker.listen.empty())
                       : Exit::start_again;
    }
}

/// Once, however often it rests.
void Service::open() {
    if (std::exchange(opened_, true))
        return;
    tell(opening_);
    if (!options_.warning.empty())
        logger_.log({LogLevel::warning, {}, {}, options_.warning});
}

void Service::tell(const std::string& text) {
    logger_.log({LogLevel::info, {}, {}, text});
}
bool Service::on_duty() const {
    return !options_.hours || options_.hours->contains(minute_now());
}

/// To those who would start it again by the age of a file. False: none can be written.
bool Service::show_life() const {
    // Opened to be emptied, it is as old as now.
    return options_.alive_file.empty() || std::ofstream(options_.alive_file).good();
}

/// From the worker's thread, about once a second.
void Service::look_at(const Load& load) {
    if (!std::exchange(is_ready_, true))
        notifier_.ready(opening_);
    notifier_.alive(net::now());
    (void)show_life();
    logger_.tell_due();
    if (leaving_ || signal_count_ > 0)
        return;
    const std::uint64_t resident = options_.duty.memory_max > 0 ? resident_bytes() : 0;
    verdict_ = duty_.judge(net::now(), load, resident);
    if (verdict_ == Duty::Verdict::go_on)
        return;
    reception_ = load.reception;
    leave(verdict_ == Duty::Verdict::enough
              ? why_it_leaves(reception_, !options_.worker.listen.empty())
              : fmt::format("has grown to {} MiB: leaves to be started again", resident >> 20));
}

/// Finishes the tiles at hand first.
void Service::leave(const std::string& why) {
    leaving_ = true;
    tell(why);
    notifier_.stopping(why);
    control_->drain();
}

/// Whether they have come; not where a signal came first.
bool Service::wait_for_hours() {
    for (bool told = false; !on_duty(); told = true) {
        const std::string text = "rests until " + time_of_day(options_.hours->begin_min);
        if (!told) {
            tell(text);
            is_ready_ ? notifier_.status(text) : notifier_.ready(text);
            is_ready_ = true;
        }
        notifier_.alive(net::now());
        (void)show_life();
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
Result<FinishReason> Service::serve() {
    control_.emplace();
    duty_ = Duty(options_.duty); // a rest is no idleness
    leaving_ = false;
    const net::Waker woken;
    std::atomic<bool> ended = false;
    std::optional<Result<FinishReason>> outcome;
    std::jthread thread([&] {
        outcome = guarded([&] { return run_worker(context_, options_.worker, *control_); });
        ended = true;
        woken.wake();
    });
    while (!ended) {
        std::vector<net::Waitable> waitables{woken.fd(), signals_.fd()};
        if (options_.hangups)
            waitables.emplace_back(options_.hangups->fd());
        net::wait(waitables, std::chrono::seconds(options_.hours ? 1 : 60));
        take_signals();
        while (options_.hangups && options_.hangups->receive())
            read_allow_list_again();
        if (!on_duty() && !leaving_.exchange(true)) {
            tell("its hours are over");
            control_->drain();
        }
    }
    thread.join();
    return *outcome;
}

/// A list that cannot be used changes nothing. Who calls and may not any more is not heard.
void Service::read_allow_list_again() {
    auto list = net::AllowList::read(options_.worker.allow);
    const auto taken = list ? context_.admit(*std::move(list)) : Result<void>(list.error());
    if (taken)
        tell("knows " + counted(context_.admitted()->size() - 1, "key") + " of " +
             options_.worker.allow.string());
    else
        logger_.log({LogLevel::error,
                     "allow_list_refused",
                     {},
                     "the keys that are known stay as they were: " + taken.error().message});
}

void Service::take_signals() {
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

} // namespace fraja::worker
