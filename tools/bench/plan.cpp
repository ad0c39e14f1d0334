// How well a farm would use its workers, from one to ten thousand: the real broker, workers and
// client in pretend time (tests/sim), with what a scene's parts really cost, counted once. Prints
// tables in Markdown, and where a farm's time goes. What the broker itself computes takes no time
// here, but with --growth.
//
// --growth: what one broker, trees of brokers and several sites make of ever more machines. There a
// broker is busy with each tile and heartbeat for as long as one was measured to be, and what comes
// meanwhile waits: so where one is not enough the farm is late.
#include "common/base/allowance.hpp"
#include "common/render/render.hpp"
#include "common/scene/raj_reader.hpp"
#include "tests/sim/scenario.hpp"
#include "tools/bench/measure.hpp"
#include "tools/bench/plan_growth.hpp"

#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

namespace fraja {
namespace {

using namespace std::chrono_literals;

constexpr std::uint32_t unit_side = 8;
constexpr double report_rays_per_s = 8791.5; // the server of 2002's report: cone.raj in 104 s

struct Options {
    RenderSettings settings{.size = {640, 480}};
    bool quick = false;
    std::uint32_t frames = 24; ///< of the film
    bool film_alone = false;   ///< no other table
    bool growth_alone = false; ///< likewise
    GrowthOptions growth;
    std::vector<std::uint32_t> workers{1, 8, 32, 48, 128, 1'000, 10'000};
    double rays_per_s = report_rays_per_s;
    Duration delay = 100us;
    std::string csv;
    std::vector<std::string> scenes;
};

constexpr const char* usage =
    R"(plan [OPTION...] SCENE.raj...: how well a farm would use its workers
plan --growth [OPTION...] SCENE.raj: what becomes of it with ever more machines, and of its brokers

The real broker, workers and client in pretend time, with what a scene's parts really cost. Prints
tables in Markdown.

  -r WxH            of the picture; 640x480 without it
  -d N              depth of recursion
  --workers N,N...  1,8,32,48,128,1000,10000 without it; with --growth 10,1000,100000
  --delay-us N      of each message; 100 without it
  --quick           few workers: to see that it works

  --rays-per-s R    of a worker; 8,791 without it, as the server of 2002's report
  --frames N        of the film; 24 without it
  --film            the film's table alone
  --csv FILE        the tables once more, for programs

With --growth:
  --job-s N         that all machines together take for the picture at best; 20 without it
  --sites N         of some rows; 4 without it
  --site-ms N       from a site to the root's, each way; 40 without it
  --site-mbit N     likewise, each way; 1000 without it
  --answer-us N     that a broker is busy with a tile that comes; 41 without it
  --mib-us N        and with each MiB of its pixels; 3200 without it
  --beat-us N       and with a heartbeat; 25 without it)";

std::vector<std::uint32_t> counts_of(const std::string& text) {
    std::vector<std::uint32_t> counts;
    for (std::size_t begin = 0; begin <= text.size();) {
        const std::size_t end = std::min(text.find(',', begin), text.size());
        counts.push_back(count_of(text.substr(begin, end - begin).c_str()));
        begin = end + 1;
    }
    return counts;
}

/// Whether it is one of --growth's, which have a number each.
bool parse_growth(const std::string& word, const char* value, GrowthOptions& growth) {
    const auto number = [&] { return static_cast<std::uint32_t>(count_of(value)); };
    if (word == "--job-s")
        growth.job = std::chrono::seconds(number());
    else if (word == "--sites")
        growth.sites = number();
    else if (word == "--site-ms")
        growth.site_delay = std::chrono::milliseconds(number());
    else if (word == "--site-mbit")
        growth.site_mbit_per_s = number();
    else if (word == "--answer-us")
        growth.costs.answer_us = number();
    else if (word == "--mib-us")
        growth.costs.mib_us = number();
    else if (word == "--beat-us")
        growth.costs.beat_us = number();
    else
        return false;
    return true;
}

Options parse(int argc, char** argv) {
    Options o;
    for (int i = 1; i < argc; ++i) {
        const std::string word = argv[i];
        if (word == "-h" || word == "--help") {
            std::puts(usage);
            std::exit(EXIT_SUCCESS);
        } else if (word == "--quick")
            o.quick = true;
        else if (word == "-r")
            o.settings.size = extent_of(argv[++i]);
        else if (word == "-d")
            o.settings.depth = count_of(argv[++i]);
        else if (word == "--growth")
            o.growth_alone = true;
        else if (word == "--workers" && i + 1 < argc)
            o.workers = o.growth.machines = counts_of(argv[++i]);
        else if (word == "--rays-per-s")
            o.rays_per_s = count_of(argv[++i]);
        else if (word == "--delay-us")
            o.delay = std::chrono::microseconds(count_of(argv[++i]));
        else if (word == "--frames" && i + 1 < argc)
            o.frames = count_of(argv[++i]);
        else if (word == "--film")
            o.film_alone = true;
        else if (word == "--csv" && i + 1 < argc)
            o.csv = argv[++i];
        else if (parse_growth(word, i + 1 < argc ? argv[i + 1] : nullptr, o.growth))
            ++i;
        else if (word.starts_with("-"))
            fail("what is " + word + "?");
        else
            o.scenes.push_back(word);
    }
    if (o.scenes.empty())
        fail(usage);
    o.growth.delay = o.delay;
    if (o.growth.sites == 0 || o.growth.job <= Duration::zero())
        fail("--sites and --job-s are at least 1");
    if (o.quick)
        o.workers = {1, 8}, o.frames = 3, o.growth.machines = {20};
    return o;
}

/// The picture's rays, counted by the kernel unit by unit, on all cores.
sim::WorkMap count_rays(const std::string& path, const RenderSettings& settings) {
    auto scene = read_raj_file(path);
    if (!scene)
        fail(scene.error().message);
    const auto compiled =
        compile_scene(std::make_shared<const Scene>(std::move(*scene)), Kernel::fast);
    const PixelRect units = cells_of({0, 0, settings.size.width, settings.size.height}, unit_side);
    std::vector<double> rays(units.pixel_count());
    std::atomic<std::size_t> next = 0;
    const auto draw = [&] {
        for (std::size_t i = next++; i < rays.size(); i = next++) {
            const auto x = static_cast<std::uint32_t>(i % units.width) * unit_side;
            const auto y = static_cast<std::uint32_t>(i / units.width) * unit_side;
            RenderControl control;
            const auto tile =
                compiled->render_tile(settings,
                                      {x, y, std::min(unit_side, settings.size.width - x),
                                       std::min(unit_side, settings.size.height - y)},
                                      control);
            if (!tile)
                fail(tile.error().message);
            rays[i] = static_cast<double>(tile->rays.traced() + tile->rays.shadow);
        }
    };
    {
        std::vector<std::jthread> crew;
        for (std::uint32_t i = 1, n = usable_processors().usable; i < n; ++i)
            crew.emplace_back(draw);
        draw();
    }
    return {settings.size, unit_side, rays};
}

// ------------------------------------------------------------------------------------------- farms

struct Farm {
    std::vector<double> speeds; ///< of each worker, in rays per second
    std::uint32_t tile_side = 0;
    protocol::Schedule schedule = protocol::Schedule::demand;
};

/// Of all that the workers' threads could have done from the submission to the end.
struct Use {
    double elapsed_s = 0;
    double useful = 0;                                   ///< the best possible time / the elapsed
    double start = 0, probe = 0, twice = 0, between = 0; ///< before the first tile; ...
    double tail = 0;                                     ///< after the last
    std::uint64_t tiles = 0;
};

/// Of a picture; or of a film of so many frames, all submitted at once.
Use simulate(const sim::WorkMap& work, const Options& o, const Farm& farm,
             std::uint32_t frames = 0) {
    sim::Scenario s;
    s.seed = 1;
    s.faults.delay_min = s.faults.delay_max = o.delay;
    s.faults.delay_max += 1us;
    s.compile_min = s.compile_max = 1ms;
    s.pixels = false;
    double speed = 0;
    for (const double rays_per_s : farm.speeds) {
        s.workers.push_back({.threads = 1, .rays_per_s = rays_per_s, .tags = {}});
        speed += rays_per_s;
    }
    sim::JobPlan job;
    job.at = 5s; // all workers are here
    job.settings.size = o.settings.size;
    job.settings.crop = {0, 0, o.settings.size.width, o.settings.size.height};
    job.tile_side = farm.tile_side;
    job.wishes.schedule = farm.schedule;
    job.work = work;
    if (frames == 0)
        s.jobs.push_back(job);
    job.wishes.film.bytes[0] = 1;
    for (job.wishes.frame = 1; job.wishes.frame <= frames; ++job.wishes.frame)
        s.jobs.push_back(job);
    s.ends_at = 24h * 365;

    const sim::Report report = sim::run(s);
    for (const std::string& violation : report.violations)
        fail(violation);
    const Duration begin = report.jobs[0].submitted_at;
    Duration end = begin;
    for (const sim::JobReport& one : report.jobs)
        end = std::max(end, one.done_at);
    Use use{.elapsed_s = seconds(end - begin)};
    const double all_s = use.elapsed_s * static_cast<double>(farm.speeds.size());
    double busy_s = 0, here_s = 0;
    for (const sim::WorkerReport& worker : report.workers) {
        busy_s += seconds(worker.busy + worker.stopped);
        const Duration first = std::min(worker.first_start, end); // none: at the end
        const Duration last = std::clamp(worker.last_end, first, end);
        use.start += seconds(first - begin);
        use.tail += first == end ? 0 : seconds(end - last);
        here_s += seconds(last - first);
        use.tiles += worker.tiles;
    }
    use.useful = static_cast<double>(s.jobs.size()) * work.rays() / speed / use.elapsed_s;
    use.start /= all_s, use.tail /= all_s;
    use.probe = seconds(report.probe) / all_s;
    use.between = (here_s - busy_s) / all_s;
    use.twice = 1 - use.useful - use.start - use.tail - use.probe - use.between;
    return use;
}

// ------------------------------------------------------------------------------------------ tables

class Tables {
public:
    explicit Tables(const std::string& csv)
        : csv_(csv.empty() ? nullptr : std::fopen(csv.c_str(), "w")) {
        if (!csv.empty() && !csv_)
            fail("cannot write " + csv);
        if (csv_)
            std::fprintf(csv_, "table,scene,size,workers,farm,elapsed_s,useful,start,probe,twice,"
                               "between,tail,tiles\n");
    }
    ~Tables() {
        if (csv_)
            std::fclose(csv_);
    }
    Tables(const Tables&) = delete;
    Tables& operator=(const Tables&) = delete;

    void begin(const std::string& title, const std::string& name) {
        name_ = name;
        std::printf(
            "\n%s\n\n| workers | farm | seconds | useful | start | probe | twice | between | "
            "tail | tiles |\n|--:|---|--:|--:|--:|--:|--:|--:|--:|--:|\n",
            title.c_str());
    }
    void row(const std::string& scene, Extent size, std::size_t workers, const std::string& farm,
             const Use& u) {
        std::printf("| %zu | %s | %.4g | %.1f %% | %.1f | %.1f | %.1f | %.1f | %.1f | %llu |\n",
                    workers, farm.c_str(), u.elapsed_s, 100 * u.useful, 100 * u.start,
                    100 * u.probe, 100 * u.twice, 100 * u.between, 100 * u.tail,
                    static_cast<unsigned long long>(u.tiles));
        std::fflush(stdout);
        if (csv_)
            std::fprintf(csv_, "%s,%s,%ux%u,%zu,%s,%.6g,%.5f,%.5f,%.5f,%.5f,%.5f,%.5f,%llu\n",
                         name_.c_str(), scene.c_str(), size.width, size.height, workers,
                         farm.c_str(), u.elapsed_s, u.useful, u.start, u.probe, u.twice, u.between,
                         u.tail, static_cast<unsigned long long>(u.tiles));
    }

private:
    std::FILE* csv_;
    std::string name_;
};

std::vector<double> equal(std::size_t count, double rays_per_s) {
    return std::vector<double>(count, rays_per_s);
}

/// Of speeds 1 : 2 : 4, a third each.
std::vector<double> mixed(std::size_t count, double rays_per_s) {
    std::vector<double> speeds;
    for (std::size_t i = 0; i < count; ++i)
        speeds.push_back(rays_per_s * static_cast<double>(1u << i % 3));
    return speeds;
}

void plan_film(const Options& o, const std::string& scene, const sim::WorkMap& work,
               Tables& tables) {
    tables.begin("A film of " + std::to_string(o.frames) + " frames as this one", "film");
    for (const std::uint32_t n : o.workers) {
        const Farm farm{equal(n, o.rays_per_s)};
        Use use = simulate(work, o, farm);
        use.elapsed_s *= o.frames; // the next is submitted when the last one is done
        use.tiles *= o.frames;
        tables.row(scene, o.settings.size, n, "one after the other", use);
        tables.row(scene, o.settings.size, n, "frames to machines",
                   simulate(work, o, farm, o.frames));
    }
}

void plan(const Options& o, const std::string& path, Tables& tables) {
    const sim::WorkMap work = count_rays(path, o.settings);
    const std::string scene = path.substr(path.find_last_of('/') + 1);
    std::printf("\n## %s, %ux%u: %.0f rays, %.1f rays/s a worker, messages take %.0f us\n",
                scene.c_str(), o.settings.size.width, o.settings.size.height, work.rays(),
                o.rays_per_s, 1e6 * seconds(o.delay));
    if (o.growth_alone)
        return plan_growth(o.growth, work, o.settings.size);
    plan_film(o, scene, work, tables);
    if (o.film_alone)
        return;
    const auto row = [&](std::size_t count, const std::string& name, const Farm& farm) {
        tables.row(scene, o.settings.size, count, name, simulate(work, o, farm));
    };
    tables.begin("Tile sizes", "tiles");
    for (const std::uint32_t n : o.workers)
        for (const std::uint32_t side : {0u, 8u, 16u, 32u, 64u})
            row(n, side == 0 ? "auto" : std::to_string(side), {equal(n, o.rays_per_s), side});
    tables.begin("Schedules", "schedules");
    constexpr const char* schedules[] = {"demand", "equal", "weighted", "stealing"};
    for (const std::uint32_t n : o.workers)
        for (unsigned i = 0; i < 4; ++i)
            row(n, schedules[i], {equal(n, o.rays_per_s), 0, protocol::Schedule(i)});
    tables.begin("Speeds", "speeds");
    for (const std::uint32_t n : o.workers) {
        row(n, "1 : 2 : 4", {mixed(n, o.rays_per_s)});
        row(n, "1,000 times as fast", {equal(n, 1'000 * o.rays_per_s)});
    }
}

} // namespace
} // namespace fraja

int main(int argc, char** argv) {
    const fraja::Options options = fraja::parse(argc, argv);
    fraja::Tables tables(options.csv);
    for (const std::string& scene : options.scenes)
        fraja::plan(options, scene, tables);
}
