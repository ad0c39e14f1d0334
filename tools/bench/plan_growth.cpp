#include "tools/bench/plan_growth.hpp"

#include "tests/sim/scenario.hpp"
#include "tools/bench/measure.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <utility>

namespace fraja {
namespace {

using namespace std::chrono_literals;

/// How the machines are connected. `fan`: so many brokers below each one of the level above; the
/// machines are spread over the lowest.
struct Shape {
    std::string name;
    std::vector<std::size_t> fan;
    bool of_sites = false; ///< the root is at none of these: what is below it is, in turn
    /// Machines of each of the lowest, at most.
    [[nodiscard]] std::size_t machines_each(std::uint32_t machines) const {
        std::size_t brokers = 1;
        for (const std::size_t below : fan)
            brokers *= below;
        return (machines + brokers - 1) / brokers;
    }
};

/// So many brokers that each has about as many connections, on a level.
std::size_t even_fan(std::uint32_t machines, std::size_t levels) {
    std::size_t fan = 2;
    const auto holds = [&](std::size_t per_broker) {
        std::size_t all = 1;
        for (std::size_t i = 0; i <= levels; ++i)
            all *= per_broker;
        return all >= machines;
    };
    while (!holds(fan))
        ++fan;
    return fan;
}

std::vector<Shape> shapes_of(std::uint32_t machines, std::uint32_t sites) {
    const std::size_t two = even_fan(machines, 1), three = even_fan(machines, 2);
    const auto times = [](std::size_t n) { return std::to_string(n) + " branches"; };
    std::vector<Shape> shapes{{"one broker", {}}, {times(two), {two}}};
    if (machines > three * three)
        shapes.push_back({std::to_string(three) + " x " + times(three), {three, three}});
    const std::string of_sites = std::to_string(sites) + " sites: ";
    shapes.push_back({of_sites + "one broker", {}, true});
    shapes.push_back({of_sites + "a branch each", {sites}, true});
    if (machines >= 10'000) {
        shapes.push_back(
            {of_sites + times(two / sites) + " each, below one", {sites, two / sites}, true});
        shapes.push_back({of_sites + times(two) + " in all, each at the root", {two}, true});
    }
    return shapes;
}

Duration from_us(double us) {
    return from_seconds(us / 1e6);
}

sim::Scenario scenario_of(const GrowthOptions& o, std::uint32_t machines, const Shape& shape,
                          const sim::WorkMap& work, Extent size) {
    sim::Scenario s;
    s.seed = 1;
    s.faults.delay_min = o.delay;
    s.faults.delay_max = o.delay + 1us;
    s.compile_min = s.compile_max = 1ms;
    s.pixels = false;
    s.ends_at = 24h;
    s.service = {.answer = from_us(o.costs.answer_us),
                 .mib = from_us(o.costs.mib_us),
                 .beat = from_us(o.costs.beat_us)};
    if (shape.of_sites)
        s.pipes.resize(o.sites, {o.site_delay, o.site_mbit_per_s * 1e6 / 8});
    std::size_t above = 0, above_count = 1; // the level's first broker, and how many it has
    for (const std::size_t fan : shape.fan) {
        const std::size_t first = s.branches.size() + 1;
        for (std::size_t i = 0; i < above_count * fan; ++i)
            s.branches.push_back({.above = above + i / fan,
                                  .pipe = shape.of_sites && above == 0 ? 1 + i % o.sites : 0});
        above = first;
        above_count *= fan;
    }
    const double rays_per_s = work.rays() / seconds(o.job) / machines;
    for (std::uint32_t i = 0; i < machines; ++i)
        s.workers.push_back({.threads = 1,
                             .rays_per_s = rays_per_s,
                             .tags = {},
                             .branch = above == 0 ? 0 : above + i % above_count,
                             .pipe = shape.of_sites && above == 0 ? 1 + i % o.sites : 0});
    sim::JobPlan job;
    job.at = 5s; // all are here
    job.settings.size = size;
    job.settings.crop = {0, 0, size.width, size.height};
    job.work = work;
    s.jobs.push_back(std::move(job));
    return s;
}

void print_row(const GrowthOptions& o, std::uint32_t machines, const Shape& shape,
               const sim::Report& report, Extent size) {
    const double elapsed_s = seconds(report.jobs[0].done_at - report.jobs[0].submitted_at);
    const sim::Traffic& root = report.traffic[0];
    std::uint64_t tiles = 0;
    for (const sim::WorkerReport& worker : report.workers)
        tiles += worker.tiles;
    const double picture_mib = 12.0 * size.width * size.height / (1 << 20);
    const double per_s = 1 / elapsed_s;
    std::printf("| %u | %s | %.1f | %.1f %% | %llu | %zu | %.0f | %.0f | %.0f | %.3f | %.0f |",
                machines, shape.name.c_str(), elapsed_s, 100 * seconds(o.job) / elapsed_s,
                static_cast<unsigned long long>(tiles), root.connections,
                static_cast<double>(root.heard + root.said) * per_s,
                static_cast<double>(root.answers) * per_s, static_cast<double>(root.beats) * per_s,
                seconds(root.busy) * per_s,
                o.costs.base_mib + picture_mib +
                    static_cast<double>(root.connections) * o.costs.connection_kib / 1024);
    double busiest = 0;
    std::size_t most = 0;
    for (std::size_t i = 1; i < report.traffic.size(); ++i) {
        busiest = std::max(busiest, seconds(report.traffic[i].busy) * per_s);
        most = std::max(most, report.traffic[i].connections);
    }
    if (report.traffic.size() > 1)
        std::printf(" %zu | %.3f |\n", most, busiest);
    else
        std::printf(" | |\n");
    std::fflush(stdout);
}

/// What heartbeats alone would take, of whoever would have too many machines.
void print_refused(const GrowthOptions& o, std::uint32_t machines, const Shape& shape) {
    const broker::Limits limits;
    const auto each = static_cast<double>(shape.machines_each(machines));
    const double beats_per_s = each / seconds(limits.heartbeat);
    std::printf("| %u | %s | refused: %zu workers at most | | | ", machines, shape.name.c_str(),
                limits.workers_max);
    if (shape.fan.empty())
        std::printf("%.0f | | | %.0f | %.3f | %.0f | | |\n", each, beats_per_s,
                    beats_per_s * o.costs.beat_us / 1e6,
                    o.costs.base_mib + each * o.costs.connection_kib / 1024);
    else
        std::printf("%zu | | | | | | %.0f | %.3f |\n", shape.fan.front(), each,
                    beats_per_s * o.costs.beat_us / 1e6);
    std::fflush(stdout);
}

} // namespace

void plan_growth(const GrowthOptions& o, const sim::WorkMap& work, Extent size) {
    const BrokerCosts& c = o.costs;
    std::printf(
        "\nMachines have one thread each, and together draw the picture in %.0f s at best; %u "
        "sites, %.0f ms and %.0f Mbit/s from each to the root's. A broker is busy for %.3g us with "
        "a "
        "tile, %.3g with each MiB of it, and %.3g with a heartbeat, and what comes meanwhile "
        "waits; it "
        "takes %.3g MiB, and %.3g KiB for a connection. What its core computes beyond that takes "
        "no "
        "time here.\n\n",
        seconds(o.job), o.sites, 1e3 * seconds(o.site_delay), o.site_mbit_per_s, c.answer_us,
        c.mib_us, c.beat_us, c.base_mib, c.connection_kib);
    std::printf("| machines | connected by | seconds | useful | tiles | root: connections | "
                "messages/s | tiles/s | beats/s | busy | MiB | branch: connections | busy |\n"
                "|--:|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|\n");
    for (const std::uint32_t machines : o.machines)
        for (const Shape& shape : shapes_of(machines, o.sites)) {
            if (shape.machines_each(machines) > broker::Limits{}.workers_max) {
                print_refused(o, machines, shape);
                continue;
            }
            const sim::Report report = sim::run(scenario_of(o, machines, shape, work, size));
            for (const std::string& violation : report.violations)
                fail(std::to_string(machines) + " machines, " + shape.name + ": " + violation);
            print_row(o, machines, shape, report, size);
        }
}

} // namespace fraja
