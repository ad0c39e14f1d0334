// The clever checked against the obvious: random scenes, drawn with both kernels.
#include "common/image/quantise.hpp"
#include "tests/support/draw.hpp"
#include "tests/support/random_scene.hpp"
#include "tests/support/scene_builder.hpp"
#include "tests/support/seeds.hpp"

#include <algorithm>
#include <cstdlib>
#include <doctest/doctest.h>
#include <span>
#include <utility>
#include <vector>

namespace fraja {
namespace {

#ifdef FRAJA_INSTRUMENTED // a build in which a ray is ten times as dear
constexpr std::uint64_t scenes = 100;
#else
constexpr std::uint64_t scenes = 1'000;
#endif

struct Comparison {
    std::size_t pixels = 0, clearly_different = 0; ///< by more than one level
};

Comparison compare(const Film& a, const Film& b) {
    const auto ours = quantise(a.pixels()), theirs = quantise(b.pixels());
    Comparison result;
    for (std::size_t p = 0; p < ours.size(); p += 3) {
        int most = 0;
        for (std::size_t i = p; i < p + 3; ++i)
            most = std::max(most, std::abs(int{ours[i]} - int{theirs[i]}));
        ++result.pixels;
        result.clearly_different += most > 1;
    }
    return result;
}

struct Both {
    Drawn want, got; ///< of the reference, of the fast kernel
};
Both draw_both(const Scene& scene, const RenderSettings& settings) {
    auto want = draw(scene, Kernel::reference, settings);
    auto got = draw(scene, Kernel::fast, settings);
    REQUIRE(want.has_value());
    REQUIRE(got.has_value());
    return {std::move(*want), std::move(*got)};
}

/// At most a thousandth of all pixels, and a hundredth of one scene's, may differ clearly.
void check_scenes(const RandomSceneOptions& options, std::uint32_t depth) {
    Comparison all;
    std::uint64_t rays = 0, rays_of_reference = 0;
    for_each_seed(scenes, [&](Rng& rng) {
        const auto [want, got] =
            draw_both(random_scene(rng, options), {.size = {32, 24}, .depth = depth});
        const Comparison here = compare(got.film, want.film);
        CHECK(100 * here.clearly_different <= here.pixels);
        all.pixels += here.pixels, all.clearly_different += here.clearly_different;
        rays += got.rays.traced(), rays_of_reference += want.rays.traced();
    });
    CHECK(1'000 * all.clearly_different <= all.pixels);
    CHECK(rays > 0);
    // Faint rays fall to this side or that of the cut by rounding.
    CHECK(1'000 * std::max(rays, rays_of_reference) <= 1'001 * std::min(rays, rays_of_reference));
}

TEST_CASE("random scenes look the same with both kernels") {
    check_scenes({}, 5);
}

TEST_CASE("so do scenes of nested aggregates and deep formulas") {
    check_scenes({.members_max = 6, .csg_depth_max = 4, .aggregate_depth_max = 3}, 12);
}

/// More than there are rays in a row of the picture, each with its own texture and as many that are
/// written out again.
TEST_CASE("so does a scene of more textures than rays, half of them the same") {
    SceneBuilder b;
    std::vector<SolidIndex> balls;
    for (int i = 0; i < 400; ++i) {
        LocalTexture local = matte(0.2 + 0.002 * (i % 200));
        local.krg = {0.3, 0.3, 0.3};
        balls.push_back(b.solid(
            Sphere{{2.0 + i % 3, 0.25 * (i % 20 - 10), 0.25 * (i / 20 - 10)}, 0.12}, local));
    }
    b.aggregate(balls);
    b.scene.world.lights = {PointLight{{-5, 3, 8}, {0.7, 0.7, 0.7}}};
    b.scene.world.background_light = {0.3, 0.5, 0.8};
    const auto [want, got] = draw_both(b.scene, {.size = {64, 48}});
    CHECK(compare(got.film, want.film).clearly_different == 0);
    CHECK(got.rays.traced() == want.rays.traced());
    CHECK(got.rays.reflected > 0);
}

/// The fast kernel's picture is the reference's, in every pixel.
void check_same(const Scene& scene, const RenderSettings& settings) {
    const auto [want, got] = draw_both(scene, settings);
    CHECK(compare(got.film, want.film).clearly_different == 0);
}

TEST_CASE("rays along a side of a cube see the cube") {
    SceneBuilder b;
    std::vector<TexturedFormIndex> sides;
    const TextureIndex texture = b.texture(matte(0.8));
    for (const Vec3& out : {Vec3{1, 0, 0}, Vec3{0, 1, 0}, Vec3{0, 0, 1}})
        for (const Vec3& side : {out, -out})
            sides.push_back(b.textured(Plane{side, side}, texture));
    b.aggregate({b.solid(b.textured(Intersection{sides}))});
    b.scene.world.background_light = {0, 0, 1};
    check_same(b.scene, {.size = {21, 21}});
    check_same(b.scene, {.size = {21, 21}, .aa = 1});
}

TEST_CASE("bodies that touch are drawn, also where another one is a composite") {
    for (const bool composite : {false, true}) {
        SceneBuilder b;
        std::vector<SolidIndex> members{
            b.solid(Sphere{{0, 0, 0}, 1}, glass(), IsotropicVolume{1.5}),
            b.solid(Plane{{0, 0, -1}, {0, 0, 1}}, matte(0.7))};
        const TextureIndex texture = b.texture(matte(0.8));
        if (composite)
            members.push_back(
                b.solid(b.textured(Intersection{{b.textured(Sphere{{5, 5, 5}, 1}, texture),
                                                 b.textured(Sphere{{5, 5, 5.5}, 1}, texture)}})));
        b.aggregate(members);
        b.scene.world.lights = {PointLight{{0, 0, 5}, {0.5, 0.5, 0.5}}};
        b.scene.world.background_light = {0, 0, 1};
        b.scene.camera = HorizontalCamera{.origin = {0, 0, 5},
                                          .direction = {0, 0, -1},
                                          .focal = 1,
                                          .screen_width = 1,
                                          .screen_height = 1};
        const auto [want, got] = draw_both(b.scene, {.size = {21, 21}, .depth = 6});
        // But for the ray to the very place.
        CHECK(compare(got.film, want.film).clearly_different <= 1);
    }
}

TEST_CASE("light along a surface shows as a highlight") {
    SceneBuilder b;
    LocalTexture shiny = matte(0);
    shiny.krl = {0.4, 0.3, 0.2}, shiny.ns = 5;
    b.aggregate({b.solid(Plane{{0, 0, -2}, {0, 0, 1}}, shiny)});
    b.scene.world.ambient_light = {};
    b.scene.world.lights = {DirectionalLight{{0, -1, 0}, {0.3, 0.5, 0.7}}};
    std::get<HorizontalCamera>(b.scene.camera).direction = {1, 1, 0};
    const RenderSettings settings{.size = {15, 15}};
    check_same(b.scene, settings);
    const auto drawn = draw(b.scene, Kernel::fast, settings);
    REQUIRE(drawn.has_value());
    CHECK(std::ranges::any_of(drawn->film.pixels(), [](float f) { return f > 0.04F; }));
}

TEST_CASE("balls that stand apart miss no overlap with glass") {
    SceneBuilder b;
    std::vector<SolidIndex> members;
    for (int i = 0; i < 60; ++i)
        members.push_back(b.solid(Sphere{{i % 10 - 2.0, i / 10 - 3.0, 0.1}, 0.4}, matte(0.5)));
    members.push_back(b.solid(Sphere{{-2, 0.2, 0}, 0.7}, glass(), IsotropicVolume{1.5}));
    b.aggregate(members);
    for (const Kernel kernel : {Kernel::reference, Kernel::fast}) {
        const auto drawn = draw(b.scene, kernel, {.size = {64, 48}});
        REQUIRE(!drawn.has_value());
        CHECK(drawn.error().code == ErrorCode::unresolved_overlap);
    }
    // With priorities there is a picture: the glass is above each ball.
    std::vector<Priority> priorities;
    for (const SolidIndex matte_one : std::span(members).first(60))
        priorities.push_back({members[60], matte_one});
    b.aggregate(members, priorities);
    const auto [want, got] = draw_both(b.scene, {.size = {64, 48}});
    CHECK(compare(got.film, want.film).clearly_different == 0);
    CHECK(got.rays.traced() == want.rays.traced());
}

} // namespace
} // namespace fraja
