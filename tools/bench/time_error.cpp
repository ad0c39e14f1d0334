// time_error [--quick] [-r WxH] [-d N] [--spp N] NAME SCENE.raj
//
// How wrong a picture is for the time it takes: draws a scene with every way of sampling, over the
// range of its settings, on one thread, and writes a line of comma-separated values for each. The
// truth is the mean of two pictures of N/2 samples per pixel (4096 in all), exact, with other
// samples than any that is judged; how far these lie apart is told on stderr. Errors are those of
// colours limited to 0..1, as a screen shows them.
#include "common/image/film.hpp"
#include "common/image/quantise.hpp"
#include "common/scene/raj_reader.hpp"
#include "tools/bench/measure.hpp"
#include "tools/bench/samplers.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <functional>
#include <string>
#include <thread>
#include <vector>

namespace fraja {
namespace {

struct Options {
    RenderSettings settings{.size = {160, 120}};
    std::uint32_t truth_spp = 4096;
    bool quick = false;
    std::string name, scene;
};

Options parse(int argc, char** argv) {
    Options o;
    std::vector<std::string> words;
    for (int i = 1; i < argc; ++i) {
        const std::string word = argv[i];
        if (word == "--quick")
            o.quick = true;
        else if (word == "-d")
            o.settings.depth = count_of(argv[++i]);
        else if (word == "--spp")
            o.truth_spp = count_of(argv[++i]);
        else if (word == "-r")
            o.settings.size = extent_of(argv[++i]);
        else if (word.starts_with("-"))
            fail("what is " + word + "?");
        else
            words.push_back(word);
    }
    if (words.size() != 2)
        fail("time_error [--quick] [-r WxH] [-d N] [--spp N] NAME SCENE.raj");
    o.name = words[0], o.scene = words[1];
    return o;
}

using DrawTile = std::function<RenderedTile(PixelRect, RenderControl&)>;

struct Drawn {
    Film film;
    RayCounts rays;
    double user_s = 0;
};

/// Tile by tile.
Drawn draw(const DrawTile& draw_tile, Extent size, unsigned threads) {
    const std::vector<PixelRect> tiles = tiles_of(size);
    std::vector<RenderedTile> parts(tiles.size());
    std::atomic<std::size_t> next = 0;
    std::atomic<double> user_s = 0;
    const auto work = [&] {
        const double begin = user_seconds();
        RenderControl control;
        for (std::size_t i = next++; i < tiles.size(); i = next++)
            parts[i] = draw_tile(tiles[i], control);
        user_s += user_seconds() - begin;
    };
    {
        std::vector<std::jthread> crew;
        for (unsigned i = 1; i < threads; ++i)
            crew.emplace_back(work);
        work();
    }
    Drawn drawn{Film(size), {}, user_s};
    for (const RenderedTile& part : parts) {
        drawn.film.place({.rect = part.tile.rect, .rgb = part.tile.rgb});
        drawn.rays += part.rays;
    }
    return drawn;
}

DrawTile with_settings(const CompiledScene& scene, const RenderSettings& settings) {
    return [&scene, settings](PixelRect rect, RenderControl& control) {
        auto tile = scene.render_tile(settings, rect, control);
        if (!tile)
            fail(tile.error().message);
        return *std::move(tile);
    };
}

double shown(float value) {
    return std::clamp(static_cast<double>(value), 0.0, 1.0);
}

double rmse_between(std::span<const float> a, std::span<const float> b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i)
        sum += (shown(a[i]) - shown(b[i])) * (shown(a[i]) - shown(b[i]));
    return std::sqrt(sum / static_cast<double>(a.size()));
}

/// From samples that nobody else takes.
std::vector<float> truth_of(const CompiledScene& scene, const Options& o) {
    RenderSettings s = o.settings;
    s.exact = true;
    s.spp = std::max(o.truth_spp / 2, 1u);
    const auto half = [&](std::uint32_t first) {
        s.first_sample = first;
        return draw(with_settings(scene, s), s.size, std::thread::hardware_concurrency()).film;
    };
    const Film one = half(1u << 24), other = half(1u << 25);
    std::vector<float> mean(one.pixels().size());
    for (std::size_t i = 0; i < mean.size(); ++i)
        mean[i] = 0.5f * (one.pixels()[i] + other.pixels()[i]);
    std::fprintf(stderr, "%s: the truth's own error is about %.6f\n", o.name.c_str(),
                 0.5 * rmse_between(one.pixels(), other.pixels()));
    return mean;
}

void print(const Options& o, const char* method, const std::string& setting, const Drawn& drawn,
           const std::vector<float>& truth) {
    const auto pixels = drawn.film.pixels();
    std::vector<double> errors(pixels.size());
    for (std::size_t i = 0; i < pixels.size(); ++i)
        errors[i] = std::abs(shown(pixels[i]) - shown(truth[i]));
    const auto at_999 = errors.begin() +
                        static_cast<std::ptrdiff_t>(0.999 * static_cast<double>(errors.size() - 1));
    std::nth_element(errors.begin(), at_999, errors.end());
    std::size_t off = 0;
    for (std::size_t i = 0; i < pixels.size(); i += 3)
        for (std::size_t c = 0; c < 3; ++c)
            if (std::abs(int{quantise(pixels[i + c])} - int{quantise(truth[i + c])}) > 1) {
                ++off;
                break;
            }
    const auto count = static_cast<double>(o.settings.size.pixel_count());
    std::printf("%s,%s,%s,%.4f,%llu,%.5f,%.7f,%.5f,%.5f,%.6f\n", o.name.c_str(), method,
                setting.c_str(), static_cast<double>(drawn.rays.camera) / count,
                static_cast<unsigned long long>(drawn.rays.traced() + drawn.rays.shadow),
                drawn.user_s, rmse_between(pixels, truth),
                *std::max_element(errors.begin(), errors.end()), *at_999,
                static_cast<double>(off) / count);
    std::fflush(stdout);
}

int run(const Options& o) {
    auto scene = read_raj_file(o.scene);
    if (!scene)
        fail(scene.error().message);
    const auto compiled =
        compile_scene(std::make_shared<const Scene>(*std::move(scene)), Kernel::fast);
    const std::vector<float> truth = truth_of(*compiled, o);
    const auto judge = [&](const char* method, const std::string& setting, const DrawTile& tile) {
        print(o, method, setting, draw(tile, o.settings.size, 1), truth);
    };
    const auto render = [&](const char* method, const std::string& setting, auto change) {
        RenderSettings s = o.settings;
        change(s);
        judge(method, setting, with_settings(*compiled, s));
    };
    const auto sample = [&](const char* method, const std::string& setting, auto sampler) {
        judge(method, setting, [&, sampler](PixelRect rect, RenderControl& control) {
            return sampler.draw(*compiled, o.settings, rect, control);
        });
    };
    render("grid", "0", [](RenderSettings&) {}); // the first run also warms up
    const std::uint32_t sides = o.quick ? 4 : 32;
    for (const std::uint32_t n : {2u, 3u, 4u, 6u, 8u, 12u, 16u, 24u, 32u})
        if (n <= sides) {
            render("grid", std::to_string(n), [&](RenderSettings& s) { s.aa = n; });
            sample("jittered", std::to_string(n), JitteredSampler{n});
        }
    for (std::uint32_t n = 4; n <= sides * sides; n *= 2)
        render("sobol-owen", std::to_string(n), [&](RenderSettings& s) { s.spp = n; });
    for (const double error : {16.0, 8.0, 4.0, 2.0, 1.0, 0.5, 0.25})
        if (error >= (o.quick ? 2 : 0.25))
            render("adaptive", text_of(error), [&](RenderSettings& s) {
                s.error = error;
                s.max_samples = 65'536;
            });
    for (const std::uint32_t n : {3u, 5u, 9u})
        for (const double threshold : {0.1, 0.03})
            if (n <= sides)
                sample("povray-1", "R" + std::to_string(n) + " A" + text_of(threshold),
                       ContrastSampler{n, threshold});
    for (const std::uint32_t depth : {2u, 3u, 4u})
        for (const double threshold : {0.1, 0.03})
            if ((1u << depth) <= sides)
                sample("povray-2", "R" + std::to_string(depth) + " A" + text_of(threshold),
                       SubdividingSampler{depth, threshold});
    return 0;
}

} // namespace
} // namespace fraja

int main(int argc, char** argv) {
    return fraja::run(fraja::parse(argc, argv));
}
