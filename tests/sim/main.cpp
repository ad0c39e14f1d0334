// fraja-sim [--hours H] [--seed S]: farms in pretend time, each with accidents of its own.
#include "tests/sim/scenario.hpp"

#include <charconv>
#include <fmt/core.h>
#include <string_view>

namespace {

template <class T>
bool read(const char* text, T& value) {
    const std::string_view t = text ? text : "";
    const auto [end, error] = std::from_chars(t.data(), t.data() + t.size(), value);
    return error == std::errc() && end == t.data() + t.size();
}

} // namespace

int main(int argc, char** argv) {
    using namespace fraja;
    double hours = 10;
    std::uint64_t first = 1;
    bool one = false;
    for (int i = 1; i < argc; i += 2) {
        const std::string_view word = argv[i];
        if (!(word == "--hours" && read(argv[i + 1], hours)) &&
            !((one = word == "--seed") && read(argv[i + 1], first))) {
            fmt::print(stderr, "fraja-sim [--hours H] [--seed S]\n"
                               "  --hours H  of pretend time, farm after farm; 10 without it\n"
                               "  --seed S   that farm alone\n");
            return 2;
        }
    }
    Duration total{};
    std::uint64_t events = 0, seed = first;
    int failed = 0;
    for (; one ? seed == first : seconds(total) < 3600 * hours; ++seed) {
        const sim::Report report = sim::run(sim::random_scenario(seed));
        total += report.ended_at;
        events += report.events;
        for (const std::string& violation : report.violations)
            fmt::print("seed {}: {}\n", seed, violation);
        failed += !report.violations.empty();
        if (one)
            fmt::print("history {:016x}\n", report.history);
    }
    fmt::print("{} farms, {:.2f} hours, {} events, {} failed\n", seed - first,
               seconds(total) / 3600, events, failed);
    return failed > 0;
}
