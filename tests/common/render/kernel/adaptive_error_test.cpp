// Pictures of as many samples as their pixels need: how good they are, and what they say of it.
#include "common/image/quantise.hpp"
#include "common/render/cut_level.hpp"
#include "tests/common/render/kernel/adaptive_picture.hpp"
#include "tests/support/draw.hpp"

#include <cmath>
#include <iterator>

namespace fraja {
namespace {

#ifdef FRAJA_INSTRUMENTED
constexpr Extent edges_size{24, 18};
constexpr std::uint32_t true_spp = 256;
#else
constexpr Extent edges_size{48, 36};
constexpr std::uint32_t true_spp = 1024;
#endif

/// In levels, of what can be seen, over pixels and colours.
double rms_difference(std::span<const float> a, std::span<const float> b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
        const double d = std::min(double{a[i]}, 1.0) - std::min(double{b[i]}, 1.0);
        sum += d * d;
    }
    return levels_per_unit * std::sqrt(sum / static_cast<double>(a.size()));
}
double rms_estimate(const Film& film) {
    double sum = 0;
    for (const float e : film.error())
        sum += double{e} * double{e};
    return levels_per_unit * std::sqrt(sum / static_cast<double>(film.error().size()));
}

TEST_CASE("a picture's error is at most what was asked for, and about what is told") {
    const RenderSettings settings{.size = edges_size, .depth = 8, .max_samples = 4096};
    constexpr double errors[] = {8, 4, 2, 1};
    double is_2[4] = {}, told_2[4] = {}; // of all scenes
    for (const Scene& scene : {edges(), of_file("checks.raj"), of_file("tumbler.raj")}) {
        const auto drawn_by = compiled(scene);
        RenderSettings many = settings;
        many.spp = true_spp;
        const Film truth = draw(*drawn_by, many).value().film;
        double last_error = 1e9, last_samples = 0;
        for (std::size_t i = 0; i < 4; ++i) {
            CAPTURE(errors[i]);
            RenderSettings adaptive = settings;
            adaptive.error = errors[i];
            const Film film = film_of(*drawn_by, adaptive);
            const double is = rms_difference(film.pixels(), truth.pixels());
            const double told = rms_estimate(film), samples = sum(film.samples());
            CHECK(is <= errors[i]);
            CHECK(told <= errors[i]);
            CHECK(is < last_error);
            CHECK(samples >= last_samples);
            last_error = is, last_samples = samples;
            is_2[i] += is * is, told_2[i] += told * told;
        }
        CHECK(last_samples > 8.0 * static_cast<double>(edges_size.pixel_count()));
    }
    for (std::size_t i = 0; i < 4; ++i) {
        CAPTURE(errors[i]);
        CHECK(told_2[i] <= 4 * is_2[i]);
        CHECK(told_2[i] >= is_2[i] / 4);
    }
}

/// A wall that mirrors the sky so faintly that it is cut, and nothing else.
TEST_CASE(
    "what was cut is told as 0.3 of the light that it may have been, whatever light there is") {
    constexpr double error = 4, cut_at_1 = 2 * error / 765;
    for (const double light : {0.05, 1.0, 20.0}) {
        CAPTURE(light);
        SceneBuilder b;
        b.scene.world.ambient_light = {};
        b.scene.world.background_light = {light, light, light};
        b.solid(Plane{{5, 0, 0}, {-1, 0, 0}}, mirror(0.9 * cut_at_1 / light));
        for (const Kernel kernel : {Kernel::fast, Kernel::reference}) {
            const auto scene = compiled(b.scene, kernel);
            const Film film = film_of(*scene, {.size = {4, 3}, .error = error});
            CHECK(std::ranges::max(film.pixels()) == 0); // cut, all of it
            const auto [least, most] = std::ranges::minmax(film.error());
            CHECK(least == most);
            CHECK(most == doctest::Approx(0.3 * 0.9 * cut_at_1));
        }
    }
}

TEST_CASE("a pass tells its samples' variance, and what was cut") {
    SceneBuilder b;
    b.scene.world.background_light = {1, 1, 1};
    b.scene.world.ambient_light = {};
    b.solid(Plane{{5, 0, 0}, {-1, 0, 0}}, mirror(0.9 / 765));
    for (const Kernel kernel : {Kernel::fast, Kernel::reference}) {
        RenderControl control;
        const auto tile =
            compiled(b.scene, kernel)
                ->render_tile({.size = {4, 3}, .spp = 8, .pass = true}, {0, 0, 4, 3}, control)
                .value()
                .tile;
        REQUIRE(tile.cut.size() == 12);
        CHECK(std::ranges::count(tile.variance, 0.0F) == 12);
        CHECK(std::ranges::min(tile.cut) == doctest::Approx(0.3 * 0.9 / 765));
        CHECK(tile.samples.empty());
    }
    RenderControl control;
    const auto tile =
        compiled(edges())
            ->render_tile({.size = {24, 18}, .spp = 8, .pass = true}, {0, 0, 24, 18}, control)
            .value()
            .tile;
    CHECK(std::ranges::max(tile.variance) > 0.01F);
    CHECK(std::ranges::min(tile.variance) >= 0);
}

TEST_CASE("where a colour has no light at all, nothing of it is missing") {
    SceneBuilder b;
    b.scene.world.ambient_light = {};
    b.scene.world.background_light = {0.8, 0, 0};
    LocalTexture blue = mirror();
    blue.krg = {0, 0, 0.9};
    b.solid(Plane{{5, 0, 0}, {-1, 0, 0}}, blue);
    CHECK(std::ranges::max(film_of(*compiled(b.scene), {.size = {4, 3}, .error = 4}).error()) == 0);
    b.scene.world.background_light = {};
    CHECK(std::ranges::max(film_of(*compiled(b.scene), {.size = {4, 3}, .error = 4}).error()) == 0);
}

TEST_CASE("background alone, or one plain surface in the light, needs hardly more than 4 samples") {
    const RenderSettings settings{.size = {64, 48}, .error = 1};
    SceneBuilder sky;
    sky.solid(Sphere{{-100, 0, 0}, 1}, matte(1));
    sky.scene.world.background_light = {0.2, 0.4, 0.6};
    CHECK(sum(film_of(*compiled(sky.scene), settings).samples()) == 4.0 * 64 * 48);
    SceneBuilder wall;
    wall.solid(Plane{{5, 0, 0}, {-1, 0.3, 0.2}}, matte(0.9));
    wall.scene.world.ambient_light = {0.1, 0.1, 0.1};
    wall.scene.world.lights = {PointLight{{2, 1, 2}, {0.8, 0.7, 0.6}}};
    const Film lit = film_of(*compiled(wall.scene), settings);
    const auto [least, most] = std::ranges::minmax(lit.pixels());
    CHECK(most > least + 0.1F);
    CHECK(sum(lit.samples()) <= 4.5 * 64 * 48);
}

TEST_CASE("pixels that all have as many samples tell their error, too") {
    const auto drawn_by = compiled(edges());
    const Film truth =
        draw(*drawn_by, {.size = edges_size, .depth = 8, .spp = true_spp}).value().film;
    for (const std::uint32_t spp : {4u, 6u, 64u}) {
        CAPTURE(spp);
        const Film film =
            draw(*drawn_by, {.size = edges_size, .depth = 8, .spp = spp}).value().film;
        REQUIRE(film.error().size() == edges_size.pixel_count());
        CHECK(std::ranges::all_of(film.samples(),
                                  [&](float n) { return n == static_cast<float>(spp); }));
        double is_2 = 0, told_2 = 0;
        for (std::size_t i = 0; i < film.error().size(); ++i) {
            told_2 += double{film.error()[i]} * double{film.error()[i]};
            for (std::size_t c = 0; c < 3; ++c) {
                const double off =
                    double{film.pixels()[3 * i + c]} - double{truth.pixels()[3 * i + c]};
                is_2 += off * off / 3;
            }
        }
        CHECK(told_2 < 4 * is_2);
        CHECK(told_2 > is_2 / 4);
    }
    CHECK(draw(*drawn_by, {.size = edges_size, .spp = 3}).value().film.error().empty());
    CHECK(draw(*drawn_by, {.size = edges_size, .aa = 2}).value().film.error().empty());
}

TEST_CASE("the cut level follows the error that is asked for") {
    const World world = edges().world;
    const Rgb raja = cut_level(world, {});
    for (const double error : {0.1, 0.5, 3.0})
        for (int c = 0; c < 3; ++c)
            CHECK(cut_level(world, {.error = error})[c] == doctest::Approx(2 * error * raja[c]));
    CHECK(cut_level(world, {.spp = 64}) == raja);
    CHECK(cut_level(world, {.error = 3, .exact = true}) == Rgb{});
}

TEST_CASE("the reference kernel's adaptive picture is about the fast one's") {
    const RenderSettings settings{.size = {24, 18}, .error = 2, .max_samples = 256};
    const Film fast = film_of(*compiled(edges()), settings);
    const Film reference = film_of(*compiled(edges(), Kernel::reference), settings);
    CHECK(rms_difference(fast.pixels(), reference.pixels()) < 2);
    CHECK(sum(reference.samples()) >= sum(fast.samples()));
    CHECK(sum(reference.samples()) < 2 * sum(fast.samples()));
}

} // namespace
} // namespace fraja
