// Pictures of as many samples as their pixels need: one picture, whatever draws it.
#include "common/render/kernel/dispatch.hpp"
#include "common/render/kernel/render.hpp"
#include "tests/common/render/kernel/adaptive_picture.hpp"
#include "tests/support/draw.hpp"

#include <bit>
#include <cmath>
#include <string>
#include <thread>

namespace fraja {
namespace {

bool same(const Film& a, const Film& b) {
    return std::ranges::equal(a.pixels(), b.pixels()) &&
           std::ranges::equal(a.samples(), b.samples()) && std::ranges::equal(a.error(), b.error());
}

TEST_CASE("an adaptive picture is the same bits for every instruction set and tile size") {
    const RenderSettings settings{.size = {53, 41}, .error = 2, .max_samples = 64};
    for (const Scene& scene : {edges(), of_file("stereo.raj"), of_file("nested_aggregate.raj")}) {
        const auto shared = std::make_shared<const Scene>(scene);
        const Film want = film_of(*compiled(scene), settings, {0, 0, 53, 41}, 53);
        CHECK(std::ranges::max(want.samples()) > 4);
        for (const kernel::KernelEntry* entry : kernel::usable_entries()) {
            const auto by_entry = kernel::compile_for(*entry, shared);
            for (const std::uint32_t side : {8u, 16u, 32u, 37u, 53u}) {
                CAPTURE(std::string(entry->isa));
                CAPTURE(side);
                CHECK(same(film_of(*by_entry, settings, {0, 0, 53, 41}, side), want));
            }
        }
    }
}

TEST_CASE("a part of an adaptive picture is what it is in the whole") {
    const RenderSettings settings{.size = {53, 41}, .error = 2, .filter = Filter::tent};
    const PixelRect part{17, 11, 23, 19};
    for (const Scene& scene : {edges(), of_file("stereo.raj")}) {
        const auto drawn_by = compiled(scene);
        const Film whole = film_of(*drawn_by, settings);
        const Film by_tiles = film_of(*drawn_by, settings, part, 8);
        CHECK(same(by_tiles, film_of(*drawn_by, settings, part, 23)));
        std::size_t different = 0;
        for (std::size_t y = 0; y < part.height; ++y)
            for (std::size_t x = 0; x < part.width; ++x) {
                const std::size_t i = y * part.width + x, k = (y + part.y) * 53 + x + part.x;
                different += by_tiles.samples()[i] != whole.samples()[k];
                different += by_tiles.error()[i] != whole.error()[k];
                for (std::size_t c = 0; c < 3; ++c)
                    different += by_tiles.pixels()[3 * i + c] != whole.pixels()[3 * k + c];
            }
        CHECK(different == 0);
    }
}

TEST_CASE("the threads that draw an adaptive picture do not show in it") {
    const auto scene = compiled(edges());
    const RenderSettings settings{.size = {40, 30}, .error = 3};
    const auto one = draw(*scene, settings, {0, 0, 40, 30}, 1);
    const auto four = draw(*scene, settings, {0, 0, 40, 30}, 4);
    REQUIRE(one.has_value());
    REQUIRE(four.has_value());
    CHECK(same(one->film, four->film));
    CHECK(one->film.samples().size() == 1200);
    CHECK(one->rays == four->rays);
}

TEST_CASE("the pixels that a tile is said to have skipped are its own") {
    SceneBuilder sky;
    sky.solid(Sphere{{-100, 0, 0}, 1}, matte(1));
    RenderControl control;
    const auto tile =
        compiled(sky.scene)->render_tile({.size = {53, 41}, .error = 2}, {10, 10, 4, 4}, control);
    REQUIRE(tile.has_value());
    CHECK(tile->rays.skipped_pixels == 16); // not of those around, whose samples it looks at
}

TEST_CASE("for what is around it a tile of 32 x 32 pixels draws 2 % of its samples at most") {
    const auto scene = compiled(edges());
    RenderControl control;
    const auto tile = scene->render_tile({.size = {96, 96}, .error = 8}, {32, 32, 32, 32}, control);
    REQUIRE(tile.has_value());
    const auto& samples = tile->tile.samples;
    const auto own = std::accumulate(samples.begin(), samples.end(), std::uint64_t{0});
    CHECK(own >= 4 * 1024);
    CHECK(tile->rays.camera == own + 66); // every other one of a frame of 132
    CHECK(66 <= 0.02 * static_cast<double>(own));
}

TEST_CASE("a pixel has 4 samples, or twice as many so often, and no more than may be") {
    const auto scene = compiled(edges());
    for (const auto& [may, most] :
         {std::pair{4u, 4.0F}, {7u, 4.0F}, {100u, 64.0F}, {128u, 128.0F}}) {
        CAPTURE(may);
        const Film film = film_of(*scene, {.size = {24, 18}, .error = 0.01, .max_samples = may});
        CHECK(std::ranges::max(film.samples()) == most);
        CHECK(std::ranges::all_of(film.samples(), [](float n) {
            return n >= 4 && std::has_single_bit(static_cast<std::uint32_t>(n)) &&
                   n == std::floor(n);
        }));
    }
}

TEST_CASE("depth 0 is black with 4 samples, and surely so") {
    for (const Kernel kernel : {Kernel::fast, Kernel::reference}) {
        const Film film =
            film_of(*compiled(edges(), kernel), {.size = {10, 8}, .depth = 0, .error = 1});
        CHECK(std::ranges::count(film.pixels(), 0.0F) == 240);
        CHECK(std::ranges::count(film.samples(), 4.0F) == 80);
        CHECK(std::ranges::count(film.error(), 0.0F) == 80);
    }
}

TEST_CASE("an adaptive tile is cancelled before its first ray, or amid its samples") {
    const RenderSettings endless{
        .size = {512, 512}, .error = 1e-9, .max_samples = 4'000'000'000, .exact = true};
    const auto scene = compiled(edges());
    for (const std::uint64_t rays : {0u, 100'000u}) {
        RenderControl control;
        control.stop = rays == 0;
        const std::jthread stopper([&] {
            while (control.rays < rays)
                std::this_thread::yield();
            control.stop = true;
        });
        const auto tile = scene->render_tile(endless, {240, 240, 32, 32}, control);
        REQUIRE(!tile.has_value());
        CHECK(tile.error().code == ErrorCode::cancelled);
        CHECK((control.rays == 0) == (rays == 0));
    }
}

} // namespace
} // namespace fraja
