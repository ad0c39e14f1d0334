// The promises of render_tile: the same bits however a picture is cut, stopping, counting.
#include "tests/common/render/kernel_under_test.hpp"
#include "tests/support/draw.hpp"
#include "tests/support/scene_builder.hpp"
#include "tests/support/seeds.hpp"

#include "common/scene/raj_reader.hpp"

#include <chrono>
#include <doctest/doctest.h>
#include <filesystem>
#include <string>

namespace fraja {
namespace {

std::shared_ptr<const CompiledScene> compile_file(const std::string& name) {
    auto scene = read_raj_file(std::filesystem::path(FRAJA_SOURCE_DIR) / "scenes" / name);
    REQUIRE(scene.has_value());
    return compile_scene(std::make_shared<const Scene>(std::move(*scene)), kernel_under_test);
}

/// A ball, half in view.
std::shared_ptr<const CompiledScene> small_scene() {
    SceneBuilder b;
    b.solid(Sphere{{0, 0.5, 0}, 1}, matte(0.5));
    return compile_scene(std::make_shared<const Scene>(b.scene), kernel_under_test);
}

TEST_CASE("a pixel's bits do not depend on the tile it is drawn in") {
    for (const std::string name : {"nested_aggregate.raj", "tumbler.raj", "stereo.raj"}) {
        CAPTURE(name);
        const auto scene = compile_file(name);
        const RenderSettings settings{.size = {23, 17}, .depth = 6, .aa = 2};
        RenderControl control;
        const auto whole = scene->render_tile(settings, {0, 0, 23, 17}, control);
        REQUIRE(whole.has_value());
        for_each_seed(5, [&](Rng& rng) {
            const auto width = static_cast<std::uint32_t>(1 + rng.below(23));
            const auto height = static_cast<std::uint32_t>(1 + rng.below(17));
            Film film(settings.size);
            RayCounts rays;
            for (std::uint32_t y = 0; y < 17; y += height)
                for (std::uint32_t x = 0; x < 23; x += width) {
                    const PixelRect rect{x, y, std::min(width, 23 - x), std::min(height, 17 - y)};
                    const auto tile = scene->render_tile(settings, rect, control);
                    REQUIRE(tile.has_value());
                    CHECK(tile->tile.rect == rect);
                    film.place(tile->tile);
                    rays += tile->rays;
                }
            CHECK(std::equal(film.pixels().begin(), film.pixels().end(), whole->tile.rgb.begin(),
                             whole->tile.rgb.end()));
            // How much had to be tested for them is the tile's.
            CHECK(rays.camera == whole->rays.camera);
            CHECK(rays.reflected == whole->rays.reflected);
            CHECK(rays.refracted == whole->rays.refracted);
            CHECK(rays.shadow == whole->rays.shadow);
            CHECK(rays.shaded == whole->rays.shaded);
        });
    }
}

TEST_CASE("the threads that draw a picture do not show in it") {
    const auto scene = compile_file("csg_drilled_cube.raj");
    const RenderSettings settings{.size = {40, 30}};
    const auto one = draw(*scene, settings, {0, 0, 40, 30}, 1);
    const auto four = draw(*scene, settings, {0, 0, 40, 30}, 4);
    REQUIRE(one.has_value());
    REQUIRE(four.has_value());
    CHECK(std::equal(one->film.pixels().begin(), one->film.pixels().end(),
                     four->film.pixels().begin()));
    CHECK(one->rays == four->rays);
}

TEST_CASE("depth 0 draws black and follows no ray") {
    RenderControl control;
    const auto tile =
        small_scene()->render_tile({.size = {4, 4}, .depth = 0}, {0, 0, 4, 4}, control);
    REQUIRE(tile.has_value());
    CHECK(tile->tile.rgb == std::vector<float>(48, 0.0f));
    CHECK(tile->rays == RayCounts{});
}

TEST_CASE("the control counts every ray") {
    RenderControl control;
    const auto tile = compile_file("mirrors.raj")
                          ->render_tile({.size = {20, 15}, .depth = 50}, {3, 3, 10, 7}, control);
    REQUIRE(tile.has_value());
    CHECK(tile->rays.camera == 70);
    CHECK(tile->rays.reflected > 0);
    CHECK(control.rays.load() == tile->rays.traced() + tile->rays.shadow);
}

TEST_CASE("a tile is cancelled before its first ray when the stop is set") {
    for (const std::uint32_t depth : {0u, 5u}) {
        RenderControl control;
        control.stop = true;
        const auto tile =
            small_scene()->render_tile({.size = {4, 4}, .depth = depth}, {0, 0, 4, 4}, control);
        REQUIRE(!tile.has_value());
        CHECK(tile.error().code == ErrorCode::cancelled);
        CHECK(control.rays.load() == 0);
    }
}

/// Draws one pixel that would take years; stops it as soon as it is under way.
Result<RenderedTile> draw_for_a_moment(const Scene& scene, const RenderSettings& settings) {
    const auto compiled = compile_scene(std::make_shared<const Scene>(scene), kernel_under_test);
    RenderControl control;
    std::jthread owner([&] {
        using namespace std::chrono_literals;
        std::this_thread::sleep_for(20ms);
        control.stop = true;
    });
    return compiled->render_tile(settings, {0, 0, 1, 1}, control);
}

TEST_CASE("a stop is heard within a pixel of very many samples") {
    SceneBuilder b;
    b.solid(Sphere{{0, 0, 0}, 1}, matte(1));
    const auto tile = draw_for_a_moment(b.scene, {.size = {1, 1}, .depth = 5, .aa = 4'000'000'000});
    REQUIRE(!tile.has_value());
    CHECK(tile.error().code == ErrorCode::cancelled);
}

TEST_CASE("a stop is heard within a path of very many bounces") {
    SceneBuilder b;
    const auto a = b.solid(Plane{{1, 0, 0}, {-1, 0, 0}}, mirror());
    const auto c = b.solid(Plane{{-6, 0, 0}, {1, 0, 0}}, mirror());
    b.aggregate({a, c});
    const auto tile = draw_for_a_moment(b.scene, {.size = {1, 1}, .depth = 4'000'000'000});
    REQUIRE(!tile.has_value());
    CHECK(tile.error().code == ErrorCode::cancelled);
}

TEST_CASE("a stop is heard within one ray's search of a form with 2^80 parts") {
    SceneBuilder b;
    TexturedFormIndex form = b.textured(Sphere{{0, 0, 0}, 1}, b.texture(matte(1)));
    for (int doubling = 0; doubling < 80; ++doubling)
        form = b.textured(Union{{form, form}});
    b.solid(form);
    const auto tile = draw_for_a_moment(b.scene, {.size = {1, 1}});
    REQUIRE(!tile.has_value());
    CHECK(tile.error().code == ErrorCode::cancelled);
}

} // namespace
} // namespace fraja
