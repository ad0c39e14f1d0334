// kernel [--reference] [--repeat N] [-r WxH] [-d N] [-a N] SCENE.raj...
//
// What a ray costs: draws each scene with one thread and prints user-mode cycles per ray and per
// sample of the fast kernel (and, with --reference, of the reference, and their ratio), with a hash
// of the picture. Cycles are the processor's own counter's where it can be read, else nanoseconds
// times the clock rate measured by a chain of additions.
#include "common/base/text.hpp"
#include "common/render/kernel/render.hpp"
#include "common/render/render.hpp"
#include "common/scene/raj_reader.hpp"
#include "tools/bench/measure.hpp"

#include <algorithm>
#include <bit>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

namespace fraja {
namespace {

struct Options {
    RenderSettings settings{.size = {640, 480}};
    bool reference = false;
    std::uint64_t repeat = 3;
    std::vector<std::string> scenes;
};

Options parse(int argc, char** argv) {
    Options o;
    const auto count = [](const char* text) {
        const auto n = parse_count(text ? text : "");
        if (!n)
            fail(std::string("not a number: ") + (text ? text : "nothing"));
        return *n;
    };
    for (int i = 1; i < argc; ++i) {
        const std::string word = argv[i];
        if (word == "--reference")
            o.reference = true;
        else if (word == "--repeat")
            o.repeat = count(argv[++i]);
        else if (word == "-d")
            o.settings.depth = static_cast<std::uint32_t>(count(argv[++i]));
        else if (word == "-a")
            o.settings.aa = static_cast<std::uint32_t>(count(argv[++i]));
        else if (word == "-r") {
            const auto size = parse_extent(argv[++i] ? argv[i] : "");
            if (!size)
                fail("-r takes WxH");
            o.settings.size = *size;
        } else if (word.starts_with("-"))
            fail("what is " + word + "?");
        else
            o.scenes.push_back(word);
    }
    if (o.scenes.empty())
        fail("kernel [--reference] [--repeat N] [-r WxH] [-d N] [-a N] SCENE.raj...");
    return o;
}

std::uint64_t hash_of(const std::vector<float>& values) { // FNV-1a
    std::uint64_t hash = 0xcbf29ce484222325;
    for (const float value : values)
        hash = (hash ^ std::bit_cast<std::uint32_t>(value)) * 0x100000001b3;
    return hash;
}

struct Measured {
    double cycles = 0;
    RayCounts rays;
    std::uint64_t hash = 0;
};

/// The least of some runs, each in tiles as a worker draws them.
Measured measure(const CycleCounter& counter, const CompiledScene& scene,
                 const RenderSettings& settings, std::uint64_t repeat) {
    Measured best;
    for (std::uint64_t run = 0; run < std::max<std::uint64_t>(repeat, 1); ++run) {
        Measured m;
        std::vector<float> picture;
        picture.reserve(3 * settings.size.pixel_count());
        constexpr std::uint32_t side = 128;
        for (std::uint32_t y = 0; y < settings.size.height; y += side)
            for (std::uint32_t x = 0; x < settings.size.width; x += side) {
                RenderControl control;
                const PixelRect rect{x, y, std::min(side, settings.size.width - x),
                                     std::min(side, settings.size.height - y)};
                const double begin = counter.now();
                const Result<RenderedTile> tile = scene.render_tile(settings, rect, control);
                m.cycles += counter.now() - begin;
                if (!tile)
                    fail(tile.error().message);
                m.rays += tile->rays;
                picture.insert(picture.end(), tile->tile.rgb.begin(), tile->tile.rgb.end());
            }
        m.hash = hash_of(picture);
        if (run == 0 || m.cycles < best.cycles)
            best = m;
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
    std::printf("%-28s %9s %9s %10s %9s %9s %9s %9s %8s  %s\n", "scene", "Mrays", "shadow",
                "cycles/spp", "cyc/ray", "cyc/all", "boxes", "forms", "ratio", "hash");
    for (const std::string& path : o.scenes) {
        auto scene = read_raj_file(path);
        if (!scene)
            fail(scene.error().message);
        const auto shared = std::make_shared<const Scene>(std::move(*scene));
        const auto m = measure(counter, *compile_scene(shared, Kernel::fast), o.settings, o.repeat);
        const auto rays = static_cast<double>(m.rays.traced());
        const auto shadow = static_cast<double>(m.rays.shadow);
        double ratio = 0;
        if (o.reference)
            ratio =
                measure(counter, *compile_scene(shared, Kernel::reference), o.settings, 1).cycles /
                m.cycles;
        std::printf("%-28s %9.3f %9.3f %10.1f %9.1f %9.1f %9.1f %9.1f %8.2f  %016llx\n",
                    path.substr(path.find_last_of('/') + 1).c_str(), rays * 1e-6, shadow * 1e-6,
                    m.cycles / static_cast<double>(std::max<std::uint64_t>(m.rays.camera, 1)),
                    m.cycles / std::max(rays, 1.0), m.cycles / std::max(rays + shadow, 1.0),
                    static_cast<double>(m.rays.box_tests) / std::max(rays + shadow, 1.0),
                    static_cast<double>(m.rays.form_tests) / std::max(rays + shadow, 1.0), ratio,
                    static_cast<unsigned long long>(m.hash));
    }
    return 0;
}

} // namespace
} // namespace fraja

int main(int argc, char** argv) {
    return fraja::run(fraja::parse(argc, argv));
}
