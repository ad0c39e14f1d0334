// fraja-sim: farms in pretend time, each with accidents of its own.
#include "tests/sim/elections.hpp"
#include "tests/sim/scenario.hpp"

#include <charconv>
#include <csignal>
#include <cstdio>
#include <fmt/core.h>
#include <string_view>
#include <utility>

namespace {

using namespace fraja;

constexpr auto usage =
    "fraja-sim [--brokers B] ([--hours H] [--from S] [--failures N] | --seed S)\n"
    "fraja-sim --elections [--brokers B] [--hours H] [--from S]\n"
    "Farms in pretend time. As the seed will have it: delay, duplicates, broken connections,\n"
    "partitions of one node or many, crashes, hangs, slow machines, bad disks, wrong clocks.\n"
    "  --brokers B   stand for each other in each farm, which has no branches then; without it in\n"
    "                every fourth farm, 2 to 5\n"
    "  --hours H     of pretend time, farm after farm; 10 without it\n"
    "  --from S      the first farm's seed; 1 without it\n"
    "  --failures N  are enough: ends then\n"
    "  --seed S      that farm alone, with all that its programs say\n"
    "  --elections   no farms, but who leads, by our rule and by the bully algorithm, with the "
    "same\n"
    "                crashes, cuts and hangs; of 3 brokers without --brokers\n"
    "INT and TERM end it after the farm at hand.\n";

volatile std::sig_atomic_t asked_to_end = 0;
std::uint64_t seed_at_hand = 0;

/// An assertion has failed, or worse: which farm was that?
void tell_seed(int signal) {
    fmt::print(stderr, "seed {} died\n", seed_at_hand);
    std::raise(signal); // as if it had not been caught
}

void tell_seed_of_deaths() {
    struct sigaction once = {};
    once.sa_handler = tell_seed;
    once.sa_flags = static_cast<int>(SA_RESETHAND);
    for (const int signal : {SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL})
        sigaction(signal, &once, nullptr);
}

struct Options {
    double hours = 10;
    std::uint64_t from = 1, failures_max = UINT64_MAX;
    std::size_t brokers = 0; // 0: as the seed will have it
    bool one = false, elections = false;
};

template <class T>
bool read(const char* text, T& value) {
    const std::string_view t = text ? text : "";
    const auto [end, error] = std::from_chars(t.data(), t.data() + t.size(), value);
    return error == std::errc() && end == t.data() + t.size();
}

bool read_option(std::string_view word, const char* value, Options& options) {
    if (word == "--seed")
        options.one = true;
    return word == "--hours"      ? read(value, options.hours)
           : word == "--failures" ? read(value, options.failures_max)
           : word == "--brokers"  ? read(value, options.brokers) && options.brokers > 0
           : word == "--from" || word == "--seed" ? read(value, options.from)
                                                  : false;
}

void compare_elections(const Options& options) {
    fmt::print("{:<6} {:>9} {:>9} {:>12} {:>14} {:>12} {:>10} {:>9}\n", "rule", "tiles", "obeyed *",
               "nobody, %", "several, %", "elections/h", "votes/s", "busiest");
    for (const auto& [name, rule] : {std::pair("ours", sim::ElectionRule::ours),
                                     std::pair("bully", sim::ElectionRule::bully)}) {
        sim::ElectionPlan plan{.rule = rule, .seed = options.from};
        if (options.brokers > 0)
            plan.brokers = options.brokers;
        plan.time = from_seconds(3600 * options.hours);
        const sim::ElectionReport report = sim::run_election(plan);
        const double time_s = seconds(plan.time);
        fmt::print("{:<6} {:>9} {:>9} {:>12.3f} {:>14.3f} {:>12.1f} {:>10.1f} {:>9.2f}\n", name,
                   report.tiles, report.replaced, 100 * seconds(report.without) / time_s,
                   100 * seconds(report.with_several) / time_s,
                   static_cast<double>(report.elections) / options.hours,
                   static_cast<double>(report.votes) / time_s, report.busiest);
    }
    fmt::print(
        "* orders by which a worker went back to a leader that it had left for another one.\n"
        "busiest: orders, answers and tiles for watchers that the busiest broker moved, for each\n"
        "tile\n");
}

} // namespace

int main(int argc, char** argv) {
    Options options;
    int i = 1;
    if (argc > 1 && argv[1] == std::string_view("--elections")) {
        options.elections = true;
        ++i;
    }
    for (; i < argc; i += 2)
        if (!read_option(argv[i], argv[i + 1], options)) {
            fmt::print(stderr, "{}", usage);
            return 2;
        }
    if (options.elections) {
        compare_elections(options);
        return 0;
    }
    Duration total{};
    std::uint64_t events = 0, failed = 0, restarts = 0, tiles = 0, duplicates = 0,
                  seed = options.from;
    for (const int signal : {SIGINT, SIGTERM})
        std::signal(signal, [](int) { asked_to_end = 1; });
    tell_seed_of_deaths();
    const auto goes_on = [&] {
        if (asked_to_end)
            return false;
        return options.one ? seed == options.from
                           : seconds(total) < 3600 * options.hours && failed < options.failures_max;
    };
    for (; goes_on(); ++seed) {
        seed_at_hand = seed;
        sim::Scenario scenario = sim::random_scenario(seed);
        if (options.brokers == 1)
            scenario.brokers = 1;
        else if (options.brokers > 1)
            sim::stand_for_each_other(scenario, options.brokers);
        if (options.one)
            scenario.on_log = [](Instant now, const std::string& line) {
                fmt::print("{:.6f} {}\n", seconds(now.since_start), line);
            };
        const sim::Report report = sim::run(scenario);
        total += report.ended_at;
        events += report.events;
        restarts += report.restarts;
        tiles += report.tiles;
        duplicates += report.duplicates;
        for (const std::string& violation : report.violations)
            fmt::print("seed {}: {}\n", seed, violation);
        std::fflush(stdout);
        failed += !report.violations.empty();
        if (options.one)
            fmt::print("history {:016x}\n", report.history);
    }
    fmt::print(
        "seeds {} to {}: {} farms, {:.2f} hours, {} events, {} tiles, {} restarts of brokers, "
        "{} duplicates, {} failed\n",
        options.from, seed - 1, seed - options.from, seconds(total) / 3600, events, tiles, restarts,
        duplicates, failed);
    return failed > 0;
}
