// What stands at the middle of each pixel.
#include "common/render/layers.hpp"

#include "tests/common/render/kernel_under_test.hpp"
#include "tests/support/draw.hpp"
#include "tests/support/random_scene.hpp"
#include "tests/support/scene_builder.hpp"
#include "tests/support/seeds.hpp"

#include <cmath>
#include <doctest/doctest.h>
#include <limits>

namespace fraja {
namespace {

constexpr Extent size{16, 16};

/// One layer of a pixel.
double layer(const Film& film, std::size_t which, std::uint32_t x, std::uint32_t y) {
    const std::size_t pixels = film.region().pixel_count();
    return static_cast<double>(film.layers()[which * pixels + y * film.region().width + x]);
}

Film layers_of(const Scene& scene, Kernel kernel = kernel_under_test) {
    auto drawn = draw(scene, kernel, {.size = size, .layers = true});
    REQUIRE(drawn.has_value());
    return std::move(drawn->film);
}

TEST_CASE(
    "a sphere has its distance from the eye, its normal and its number; the rest is nothing") {
    SceneBuilder b;
    b.solid(Sphere{{0, 0, 30}, 1}, {}); // out of sight
    const SolidIndex low = b.solid(Sphere{{0, 0, 0}, 1}, {});
    b.aggregate({SolidIndex{0}, low});
    const Film film = layers_of(b.scene);
    for (std::uint32_t y = 0; y < size.height; ++y)
        for (std::uint32_t x = 0; x < size.width; ++x) {
            CAPTURE(x);
            CAPTURE(y);
            // The ray from the eye at (-5, 0, 0) through the middle of the pixel.
            const Vec3 dir = normalized({1, 0.5 - (x + 0.5) / 16, 0.5 - (y + 0.5) / 16});
            const double middle = 5 * dir.x, below = middle * middle - 24;
            if (below < 0) {
                CHECK(layer(film, 0, x, y) == std::numeric_limits<double>::infinity());
                for (std::size_t i = 1; i < layer_names.size(); ++i)
                    CHECK(layer(film, i, x, y) == 0);
                continue;
            }
            const double distance = middle - std::sqrt(below);
            const Vec3 place = Vec3{-5, 0, 0} + distance * dir;
            CHECK(layer(film, 0, x, y) == doctest::Approx(distance).epsilon(1e-6));
            CHECK(layer(film, 1, x, y) == doctest::Approx(place.x).epsilon(1e-6));
            CHECK(layer(film, 2, x, y) == doctest::Approx(place.y).epsilon(1e-6));
            CHECK(layer(film, 3, x, y) == doctest::Approx(place.z).epsilon(1e-6));
            CHECK(layer(film, 4, x, y) == static_cast<double>(as_size(low)) + 1);
        }
}

TEST_CASE("layers are of a pixel's middle, however the pixel is sampled and cut into tiles") {
    for_each_seed(5, [](Rng& rng) {
        const Scene scene = random_scene(rng, {});
        const Film want = layers_of(scene);
        for (const RenderSettings& settings :
             {RenderSettings{.size = size, .aa = 3, .layers = true},
              RenderSettings{.size = size, .spp = 8, .layers = true},
              RenderSettings{.size = size, .error = 8, .max_samples = 16, .layers = true}}) {
            const auto compiled =
                compile_scene(std::make_shared<const Scene>(scene), kernel_under_test);
            RenderControl control, control_without;
            RenderSettings without = settings;
            without.layers = false;
            REQUIRE(compiled->render_tile(without, {3, 5, 7, 9}, control_without).has_value());
            const auto tile = compiled->render_tile(settings, {3, 5, 7, 9}, control);
            REQUIRE(tile.has_value());
            CHECK(control.rays - control_without.rays == 7 * 9); // seen to be alive
            Film part(size, {3, 5, 7, 9}, {.estimates = settings.estimates(), .layers = true});
            part.place(tile->tile);
            for (std::size_t i = 0; i < layer_names.size(); ++i)
                for (std::uint32_t y = 0; y < 9; ++y)
                    for (std::uint32_t x = 0; x < 7; ++x)
                        CHECK(layer(part, i, x, y) == layer(want, i, x + 3, y + 5));
        }
    });
}

TEST_CASE("a picture is the same with layers as without") {
    for_each_seed(5, [](Rng& rng) {
        const Scene scene = random_scene(rng, {});
        const auto with = draw(scene, kernel_under_test, {.size = size, .layers = true});
        const auto without = draw(scene, kernel_under_test, {.size = size});
        REQUIRE(with.has_value());
        REQUIRE(without.has_value());
        CHECK(std::ranges::equal(with->film.pixels(), without->film.pixels()));
        CHECK(with->rays.camera == 2 * without->rays.camera);
        CHECK(with->rays.shadow == without->rays.shadow);
    });
}

TEST_CASE("an order to stop is heard among the layers") {
    SceneBuilder b;
    b.solid(Sphere{{0, 0, 0}, 1}, {});
    const auto scene = compile_scene(std::make_shared<const Scene>(b.scene), kernel_under_test);
    RenderedTile tile{.tile = {.rect = {0, 0, 16, 16}, .rgb = {}}};
    RenderControl control;
    control.stop = true;
    const auto added = add_layers(*scene, {.size = size}, tile, control);
    REQUIRE_FALSE(added.has_value());
    CHECK(added.error().code == ErrorCode::cancelled);
}

#ifdef FRAJA_TEST_FAST_KERNEL
TEST_CASE("both kernels see the same solids at the same places") {
    std::size_t pixels = 0, other_objects = 0;
    for_each_seed(200, [&](Rng& rng) {
        const Scene scene = random_scene(rng, {});
        const Film want = layers_of(scene, Kernel::reference);
        const Film got = layers_of(scene, Kernel::fast);
        for (std::uint32_t y = 0; y < size.height; ++y)
            for (std::uint32_t x = 0; x < size.width; ++x) {
                ++pixels;
                if (layer(got, 4, x, y) != layer(want, 4, x, y)) {
                    ++other_objects; // at an edge, or where surfaces coincide
                    continue;
                }
                for (std::size_t i = 0; i < layer_names.size(); ++i)
                    if (layer(got, i, x, y) != layer(want, i, x, y)) // infinity is itself
                        CHECK(layer(got, i, x, y) ==
                              doctest::Approx(layer(want, i, x, y)).epsilon(1e-5));
            }
    });
    CHECK(1000 * other_objects <= pixels);
}
#endif

} // namespace
} // namespace fraja
