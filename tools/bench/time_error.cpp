// time_error [--quick] [--adaptive] [-r WxH] [-d N] [--spp N] [--truth FILE] NAME SCENE.raj
//
// How wrong a picture is for the time it takes: draws a scene with every way of sampling, or the
// adaptive one alone, over the range of its settings, on one thread. The truth is the mean of two
// pictures of N/2 samples per pixel (4096 in all), exact, with other samples than any that is
// judged. Errors are those of colours limited to 0..1, as a screen shows them. Writes lines of
// comma-separated values, the first of each says what it is:
//
//   truth,scene,rmse                 about how wrong the truth is
//   run,scene,method,setting,spp,rays,user_s,rmse,max_error,p999,off_by_more_than_one
//   kept,scene,wanted,spp,refined,refined_rms,rmse,estimated_rmse,halo
//
// `kept`, of an adaptive run: the share of pixels that were refined, errors in 8-bit levels, and
// the share of samples that were drawn for tiles beside. --truth: a file for the truth, as floats.
#include "common/base/allowance.hpp"
#include "common/image/film.hpp"
#include "common/image/quantise.hpp"
#include "common/render/sampling/estimate.hpp"
#include "common/scene/raj_reader.hpp"
#include "tools/bench/measure.hpp"
#include "tools/bench/samplers.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <string>
#include <thread>
#include <vector>

namespace fraja {
namespace {

struct Options {
    RenderSettings settings{.size = {160, 120}};
    std::uint32_t truth_spp = 4096;
    bool quick = false, adaptive_only = false;
    std::string name, scene, truth_file;
};

Options parse(int argc, char** argv) {
    Options o;
    std::vector<std::string> words;
    for (int i = 1; i < argc; ++i) {
        const std::string word = argv[i];
        if (word == "--quick")
            o.quick = true;
        else if (word == "--adaptive")
            o.adaptive_only = true;
        else if (word == "-d")
            o.settings.depth = count_of(argv[++i]);
        else if (word == "--spp")
            o.truth_spp = count_of(argv[++i]);
        else if (word == "--truth" && i + 1 < argc)
            o.truth_file = argv[++i];
        else if (word == "-r")
            o.settings.size = extent_of(argv[++i]);
        else if (word.starts_with("-"))
            fail("what is " + word + "?");
        else
            words.push_back(word);
    }
    if (words.size() != 2)
        fail("time_error [--quick] [--adaptive] [-r WxH] [-d N] [--spp N] [--truth FILE] NAME "
             "SCENE.raj");
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
Drawn draw(const DrawTile& draw_tile, Extent size, unsigned threads, Film::Keeps keeps = {}) {
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
    Drawn drawn{Film(size, {0, 0, size.width, size.height}, keeps), {}, user_s};
    for (RenderedTile& part : parts) {
        if (!keeps.estimates)
            part.tile = {.rect = part.tile.rect, .rgb = std::move(part.tile.rgb)};
        drawn.film.place(part.tile);
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

double mean_of(std::span<const double> values) {
    double sum = 0;
    for (const double value : values)
        sum += value;
    return values.empty() ? 0 : sum / static_cast<double>(values.size());
}

/// Of each component.
std::vector<double> errors_between(std::span<const float> a, std::span<const float> b) {
    std::vector<double> errors(a.size());
    for (std::size_t i = 0; i < a.size(); ++i)
        errors[i] = std::abs(shown(a[i]) - shown(b[i]));
    return errors;
}

double rms(std::vector<double> values) {
    for (double& value : values)
        value *= value;
    return std::sqrt(mean_of(values));
}

struct Truth {
    std::vector<float> rgb;
    double error; ///< about
};

/// From samples that have nothing to do with those that are judged, nor its halves' with each
/// other.
Truth truth_of(const CompiledScene& scene, const Options& o) {
    RenderSettings s = o.settings;
    s.exact = true;
    s.spp = std::max(o.truth_spp / 2, 1u);
    const auto half = [&](std::uint32_t seed) {
        s.seed = seed;
        return draw(with_settings(scene, s), s.size, usable_processors().usable).film;
    };
    const Film one = half(1), other = half(2);
    Truth truth{{}, 0.5 * rms(errors_between(one.pixels(), other.pixels()))};
    for (std::size_t i = 0; i < one.pixels().size(); ++i)
        truth.rgb.push_back(0.5f * (one.pixels()[i] + other.pixels()[i]));
    std::printf("truth,%s,%.7f\n", o.name.c_str(), truth.error);
    return truth;
}

constexpr double too_long_s = 60; ///< for a picture: a method's range ends there

/// Whether another setting, with more samples, is worth its time.
bool print_run(const Options& o, const char* method, const std::string& setting, const Drawn& drawn,
               const Truth& truth) {
    const auto pixels = drawn.film.pixels();
    std::vector<double> errors = errors_between(pixels, truth.rgb);
    const double rmse = rms(errors);
    const auto at_999 = errors.begin() +
                        static_cast<std::ptrdiff_t>(0.999 * static_cast<double>(errors.size() - 1));
    std::nth_element(errors.begin(), at_999, errors.end());
    std::size_t off = 0;
    for (std::size_t i = 0; i < pixels.size(); i += 3)
        for (std::size_t c = 0; c < 3; ++c)
            if (std::abs(int{quantise(pixels[i + c])} - int{quantise(truth.rgb[i + c])}) > 1) {
                ++off;
                break;
            }
    const auto count = static_cast<double>(o.settings.size.pixel_count());
    std::printf("run,%s,%s,%s,%.4f,%llu,%.5f,%.7f,%.5f,%.5f,%.6f\n", o.name.c_str(), method,
                setting.c_str(), static_cast<double>(drawn.rays.camera) / count,
                static_cast<unsigned long long>(drawn.rays.traced() + drawn.rays.shadow),
                drawn.user_s, rmse, *std::max_element(errors.begin(), errors.end()), *at_999,
                static_cast<double>(off) / count);
    std::fflush(stdout);
    return rmse > 2 * truth.error && drawn.user_s < too_long_s;
}

void print_kept(const Options& o, double wanted, const Drawn& drawn, const Truth& truth) {
    const Film& film = drawn.film;
    const std::vector<double> errors = errors_between(film.pixels(), truth.rgb);
    std::vector<double> refined;
    double samples = 0;
    for (std::size_t i = 0; i < film.samples().size(); ++i) {
        samples += static_cast<double>(film.samples()[i]);
        if (film.samples()[i] > base_samples)
            refined.insert(refined.end(), &errors[3 * i], &errors[3 * i] + 3);
    }
    const auto count = static_cast<double>(film.samples().size());
    const auto drawn_samples = static_cast<double>(drawn.rays.camera);
    std::printf("kept,%s,%s,%.4f,%.4f,%.4f,%.4f,%.4f,%.4f\n", o.name.c_str(),
                text_of(wanted).c_str(), samples / count,
                static_cast<double>(refined.size()) / static_cast<double>(errors.size()),
                levels_per_unit * rms(refined), levels_per_unit * rms(errors),
                levels_per_unit * rms({film.error().begin(), film.error().end()}),
                (drawn_samples - samples) / drawn_samples);
}

int run(const Options& o) {
    auto scene = read_raj_file(o.scene);
    if (!scene)
        fail(scene.error().message);
    const auto compiled =
        compile_scene(std::make_shared<const Scene>(*std::move(scene)), Kernel::fast);
    const Truth truth = truth_of(*compiled, o);
    if (!o.truth_file.empty()) {
        std::ofstream file(o.truth_file, std::ios::binary);
        file.write(reinterpret_cast<const char*>(truth.rgb.data()),
                   static_cast<std::streamsize>(truth.rgb.size() * sizeof(float)));
        if (!file.flush())
            fail("cannot write " + o.truth_file);
    }
    const auto judge = [&](const char* method, const std::string& setting, const DrawTile& tile) {
        return print_run(o, method, setting, draw(tile, o.settings.size, 1), truth);
    };
    const auto render = [&](const char* method, const std::string& setting, auto change) {
        RenderSettings s = o.settings;
        change(s);
        return judge(method, setting, with_settings(*compiled, s));
    };
    const auto sample = [&](const char* method, const std::string& setting, auto sampler) {
        return judge(method, setting, [&, sampler](PixelRect rect, RenderControl& control) {
            return sampler.draw(*compiled, o.settings, rect, control);
        });
    };
    const auto adaptive = [&](double error) {
        RenderSettings s = o.settings;
        s.error = error, s.max_samples = 65'536;
        const Drawn drawn = draw(with_settings(*compiled, s), s.size, 1, {.estimates = true});
        print_kept(o, error, drawn, truth);
        print_run(o, "adaptive", text_of(error), drawn, truth);
        return drawn.user_s < too_long_s; // and whatever the truth's error is
    };
    const std::uint32_t sides = o.quick ? 4 : 32;
    render("grid", "0", [](RenderSettings&) {}); // the first run also warms up
    for (const double error : {16.0, 8.0, 4.0, 2.0, 1.0, 0.5, 0.25})
        if (error < (o.quick ? 2 : 0.25) || !adaptive(error))
            break;
    if (o.adaptive_only)
        return 0;
    constexpr std::array grids = {2u, 3u, 4u, 6u, 8u, 12u, 16u, 24u, 32u};
    for (const std::uint32_t n : grids)
        if (n > sides || !render("grid", std::to_string(n), [&](RenderSettings& s) { s.aa = n; }))
            break;
    for (const std::uint32_t n : grids)
        if (n > sides || !sample("jittered", std::to_string(n), JitteredSampler{n}))
            break;
    for (std::uint32_t n = 4; n <= sides * sides; n *= 2)
        if (!render("sobol-owen", std::to_string(n), [&](RenderSettings& s) { s.spp = n; }))
            break;
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
