// kernel [--reference] [--repeat N] [-r WxH] [-d N] [-a N] [-j N] SCENE.raj...
//
// What a ray costs: draws each scene with one thread, or -j, and prints user-mode cycles per ray
// and per sample of the fast kernel (and, with --reference, of the reference, and their ratio),
// with a hash of the picture. Cycles are the processor's own counter's where it can be read, else
// nanoseconds times the clock rate measured by a chain of additions.
#include "common/render/kernel/render.hpp"
#include "common/render/render.hpp"
#include "common/scene/raj_reader.hpp"
#include "tools/bench/measure.hpp"

#include <algorithm>
#include <atomic>
#include <bit>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace fraja {
namespace {

struct Options {
    RenderSettings settings{.size = {640, 480}};
    bool reference = false;
    std::uint64_t repeat = 3, threads = 1;
    std::vector<std::string> scenes;
};

Options parse(int argc, char** argv) {
    Options o;
    for (int i = 1; i < argc; ++i) {
        const std::string word = argv[i];
        if (word == "--reference")
            o.reference = true;
        else if (word == "--repeat")
            o.repeat = count_of(argv[++i]);
        else if (word == "-j")
            o.threads = count_of(argv[++i]);
        else if (word == "-d")
            o.settings.depth = count_of(argv[++i]);
        else if (word == "-a")
            o.settings.aa = count_of(argv[++i]);
        else if (word == "-r")
            o.settings.size = extent_of(argv[++i]);
        else if (word.starts_with("-"))
            fail("what is " + word + "?");
        else
            o.scenes.push_back(word);
    }
    if (o.scenes.empty())
        fail("kernel [--reference] [--repeat N] [-r WxH] [-d N] [-a N] [-j N] SCENE.raj...");
    return o;
}

std::uint64_t hash_of(const std::vector<float>& values, std::uint64_t before) { // FNV-1a
    std::uint64_t hash = before == 0 ? 0xcbf29ce484222325 : before;
    for (const float value : values)
        hash = (hash ^ std::bit_cast<std::uint32_t>(value)) * 0x100000001b3;
    return hash;
}

struct Measured {
    double cycles = 0, seconds = 0;
    RayCounts rays;
    std::uint64_t hash = 0;
};

/// One run, in tiles as a worker's threads draw them; cycles are those of all threads.
Measured measure_once(double clock_rate, const CompiledScene& scene, const Options& o) {
    const std::vector<PixelRect> tiles = tiles_of(o.settings.size);
    std::vector<std::vector<float>> drawn(tiles.size());
    Measured m;
    std::mutex mutex; // guards m
    std::atomic<std::size_t> next = 0;
    const auto draw = [&] {
        const CycleCounter counter(clock_rate); // a thread's own
        double cycles = 0;
        RayCounts rays;
        for (std::size_t i = next++; i < tiles.size(); i = next++) {
            RenderControl control;
            const double begin = counter.now();
            Result<RenderedTile> tile = scene.render_tile(o.settings, tiles[i], control);
            cycles += counter.now() - begin;
            if (!tile)
                fail(tile.error().message);
            rays += tile->rays;
            drawn[i] = std::move(tile->tile.rgb);
        }
        const std::scoped_lock lock(mutex);
        m.cycles += cycles, m.rays += rays;
    };
    const auto begin = std::chrono::steady_clock::now();
    {
        std::vector<std::jthread> crew;
        for (std::uint64_t i = 1; i < o.threads; ++i)
            crew.emplace_back(draw);
        draw();
    }
    m.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    for (const std::vector<float>& tile : drawn)
        m.hash = hash_of(tile, m.hash);
    return m;
}

/// The least of some runs.
Measured measure(double clock_rate, const CompiledScene& scene, const Options& o,
                 std::uint64_t repeat) {
    Measured best;
    for (std::uint64_t run = 0; run < std::max<std::uint64_t>(repeat, 1); ++run) {
        const Measured m = measure_once(clock_rate, scene, o);
        const double seconds = run == 0 ? m.seconds : std::min(m.seconds, best.seconds);
        if (run == 0 || m.cycles < best.cycles)
            best = m;
        best.seconds = seconds;
    }
    return best;
}

int run(const Options& o) {
    const CycleCounter counter;
    const Result<std::string> isa = kernel::instruction_set();
    if (!isa)
        fail(isa.error().message);
    std::printf("%s, %s, %ux%u depth %u aa %u, best of %llu\n", isa->c_str(),
                counter.counts() ? "cycles counted by the processor"
                                 : "cycles from time and a measured clock rate",
                o.settings.size.width, o.settings.size.height, o.settings.depth, o.settings.aa,
                static_cast<unsigned long long>(o.repeat));
    std::printf("%-28s %9s %9s %10s %9s %9s %9s %9s %8s %8s  %s\n", "scene", "Mrays", "shadow",
                "cycles/spp", "cyc/ray", "cyc/all", "boxes", "forms", "ratio", "seconds", "hash");
    for (const std::string& path : o.scenes) {
        auto scene = read_raj_file(path);
        if (!scene)
            fail(scene.error().message);
        const auto shared = std::make_shared<const Scene>(std::move(*scene));
        const auto m =
            measure(counter.clock_rate(), *compile_scene(shared, Kernel::fast), o, o.repeat);
        const auto rays = static_cast<double>(m.rays.traced());
        const auto shadow = static_cast<double>(m.rays.shadow);
        double ratio = 0;
        if (o.reference)
            ratio = measure(counter.clock_rate(), *compile_scene(shared, Kernel::reference), o, 1)
                        .cycles /
                    m.cycles;
        std::printf("%-28s %9.3f %9.3f %10.1f %9.1f %9.1f %9.1f %9.1f %8.2f %8.3f  %016llx\n",
                    path.substr(path.find_last_of('/') + 1).c_str(), rays * 1e-6, shadow * 1e-6,
                    m.cycles / static_cast<double>(std::max<std::uint64_t>(m.rays.camera, 1)),
                    m.cycles / std::max(rays, 1.0), m.cycles / std::max(rays + shadow, 1.0),
                    static_cast<double>(m.rays.box_tests) / std::max(rays + shadow, 1.0),
                    static_cast<double>(m.rays.form_tests) / std::max(rays + shadow, 1.0), ratio,
                    m.seconds, static_cast<unsigned long long>(m.hash));
    }
    return 0;
}

} // namespace
} // namespace fraja

int main(int argc, char** argv) {
    return fraja::run(fraja::parse(argc, argv));
}
