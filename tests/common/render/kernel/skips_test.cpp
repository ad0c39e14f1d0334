// What a scene does not need is not done: shown by the counters.
#include "common/render/kernel/dispatch.hpp"
#include "common/render/kernel/program.hpp"
#include "tests/support/draw.hpp"
#include "tests/support/scene_builder.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <vector>

namespace fraja {
namespace {

constexpr Extent size{32, 24};

RayCounts counts(const Scene& scene, const RenderSettings& settings = {.size = size}) {
    const auto drawn = draw(scene, Kernel::fast, settings);
    REQUIRE(drawn.has_value());
    return drawn->rays;
}

/// A ball before the camera, and a lamp that it can see.
SceneBuilder ball_and_lamp(const LocalTexture& texture, const Volume& volume = IsotropicVolume{1}) {
    SceneBuilder b;
    b.aggregate({b.solid(Sphere{{5, 0, 0}, 2}, texture, volume)});
    b.scene.world.lights = {PointLight{{-5, 3, 8}, {0.5, 0.5, 0.5}}};
    b.scene.world.ambient_light = {0.1, 0.1, 0.1};
    b.scene.world.background_light = {1, 1, 1};
    return b;
}

TEST_CASE("a ball under a lamp costs a shadow ray where it faces the lamp, and no more") {
    const RayCounts n = counts(ball_and_lamp(matte(0.5)).scene);
    CHECK(n.camera == size.width * size.height);
    CHECK(n.shaded > 0);
    CHECK(n.shadow > 0);
    CHECK(n.shadow < n.shaded); // its dark side faces away
    CHECK(n.reflected == 0);
    CHECK(n.refracted == 0);
}

TEST_CASE("no lights, or black ones, and no shadow rays") {
    SceneBuilder b = ball_and_lamp(matte(0.5));
    b.scene.world.lights = {PointLight{{-5, 3, 8}, {0, 0, 0}}};
    CHECK(counts(b.scene).shadow == 0);
    b.scene.world.lights.clear();
    CHECK(counts(b.scene).shadow == 0);
}

TEST_CASE(
    "what light does not show on sends no shadow rays; what mirrors nothing, no mirror rays") {
    LocalTexture dark = matte(0);
    dark.krg = {0.5, 0.5, 0.5};
    const RayCounts n = counts(ball_and_lamp(dark).scene);
    CHECK(n.shadow == 0);
    CHECK(n.reflected == n.shaded);
    CHECK(counts(ball_and_lamp(matte(0.5)).scene).reflected == 0);
}

TEST_CASE("a light in another volume than a point is known to be hidden") {
    LocalTexture clear = glass();
    clear.kd = {0.2, 0.2, 0.2};
    SceneBuilder b = ball_and_lamp(clear, IsotropicVolume{1});
    const RayCounts outside = counts(b.scene, {.size = size, .depth = 2});
    // Hits from within the ball: the lamp is outside. Every ray of depth 2 is such a hit.
    const RayCounts first_hits = counts(b.scene, {.size = size, .depth = 1});
    CHECK(outside.refracted > 0);
    CHECK(outside.shadow == first_hits.shadow);
}

TEST_CASE("where indices are equal the same ray goes on, and nothing is reflected") {
    LocalTexture clear = glass();
    const RayCounts n = counts(ball_and_lamp(clear, IsotropicVolume{1}).scene,
                               {.size = size, .depth = 8, .exact = true});
    CHECK(n.refracted > 0);
    CHECK(n.reflected == 0);
    CHECK(counts(ball_and_lamp(clear, IsotropicVolume{1.5}).scene, {.size = size, .depth = 8})
              .reflected > 0);
}

TEST_CASE("what lies beside every solid is background without a ray traced") {
    SceneBuilder b = ball_and_lamp(matte(0.5));
    const RenderSettings settings{.size = {256, 192}};
    const RayCounts ball = counts(b.scene, settings);
    // Its disc of 2/10 of the picture's side, and blocks of 32 x 32 around it.
    CHECK(ball.skipped_pixels > 256 * 192 / 4);
    CHECK(ball.skipped_pixels < 256 * 192 * 9 / 10);
    CHECK(ball.camera == 256 * 192); // counted all the same
    std::get<HorizontalCamera>(b.scene.camera).direction = {-1, 0, 0};
    const RayCounts away = counts(b.scene, settings);
    CHECK(away.skipped_pixels == 256 * 192);
    CHECK(away.form_tests + away.box_tests + away.shaded == 0);
    CHECK(counts(b.scene, {.size = size, .aa = 40}).skipped_pixels == size.pixel_count());
}

TEST_CASE("where there is a plane and nothing else, none is searched for") {
    SceneBuilder b;
    b.aggregate({b.solid(Plane{{0, 0, -3}, {0, 0, 1}}, matte(0.5)),
                 b.solid(Sphere{{100, 0, 40}, 5}, glass(), IsotropicVolume{1.5})});
    auto& camera = std::get<HorizontalCamera>(b.scene.camera);
    camera.direction = normalized({0.2, 0, -1});
    const RayCounts down = counts(b.scene);
    CHECK(down.skipped_pixels == size.pixel_count());
    CHECK(down.shaded == size.pixel_count());
    CHECK(down.form_tests + down.box_tests == 0);
    camera.direction = {1, 0, 0}; // to the horizon, which needs a search
    const RayCounts ahead = counts(b.scene, {.size = {128, 96}});
    CHECK(ahead.skipped_pixels >= 128 * 32);
    CHECK(ahead.skipped_pixels < 128 * 96);
}

/// The ball and the lamp above a floor, and what else there is.
Scene with_floor(const std::vector<Sphere>& more, const LocalTexture& floor,
                 const LocalTexture& texture) {
    SceneBuilder b = ball_and_lamp(matte(0.5));
    std::vector<SolidIndex> members{b.scene.world.solid};
    members.push_back(b.solid(Plane{{0, 0, -3}, {0, 0, 1}}, floor, IsotropicVolume{1.5}));
    for (const Sphere& sphere : more)
        members.push_back(b.solid(sphere, texture, IsotropicVolume{1.5}));
    b.aggregate(members);
    return b.scene;
}

TEST_CASE("a solid that an opaque one hides costs nothing, nor do its surfaces") {
    const Sphere below{{5, 1, -6}, 2}, within{{5, 0, 0.5}, 1}, half{{5, 3, -3}, 1};
    const RayCounts bare = counts(with_floor({}, matte(0.5), mirror()));
    CHECK(counts(with_floor({below}, matte(0.5), mirror())) == bare);
    CHECK(counts(with_floor({below, within}, matte(0.5), mirror())) == bare);
    CHECK(counts(with_floor({below, within}, matte(0.5), glass())) == bare);
    CHECK(counts(with_floor({half}, matte(0.5), mirror())).form_tests > bare.form_tests);
    // Of many, which have a hierarchy, as well.
    std::vector<Sphere> many(100, below);
    for (std::size_t i = 0; i < many.size(); ++i)
        many[i].center.y += 0.01 * static_cast<double>(i);
    const std::vector<Sphere> fewer(many.begin(), many.begin() + 30);
    CHECK(counts(with_floor(many, matte(0.5), mirror())) ==
          counts(with_floor(fewer, matte(0.5), mirror())));
}

TEST_CASE("through a glass floor what lies below is seen") {
    const auto shaded = [](double depth) {
        SceneBuilder b = ball_and_lamp(matte(0.5));
        const SolidIndex above = b.scene.world.solid;
        const SolidIndex floor =
            b.solid(Plane{{0, 0, -3}, {0, 0, 1}}, glass(), IsotropicVolume{1.1});
        const SolidIndex below = b.solid(Sphere{{12, 0, depth}, 2}, matte(0.5));
        b.aggregate({above, floor, below}, {{below, floor}});
        return counts(b.scene).shaded;
    };
    CHECK(shaded(-5.5) > shaded(-500));
}

TEST_CASE("what lies beside the picture costs nothing where there are only camera rays") {
    const std::vector<Sphere> beside{Sphere{{5, 40, 0}, 2}, Sphere{{-20, 0, 0}, 2}};
    Scene bare = with_floor({}, matte(0.5), matte(0.5));
    Scene more = with_floor(beside, matte(0.5), matte(0.5));
    CHECK(counts(more).form_tests > counts(bare).form_tests); // it may throw a shadow
    bare.world.lights.clear(), more.world.lights.clear();
    CHECK(counts(more) == counts(bare));
    Scene mirrors = with_floor(beside, mirror(), matte(0.5));
    mirrors.world.lights.clear();
    CHECK(counts(mirrors).form_tests > counts(bare).form_tests);
}

/// The fast kernel's picture of a scene is the reference's, and something in it is as bright.
void check_seen(const Scene& scene, float bright) {
    const RenderSettings settings{.size = {64, 48}};
    const auto want = draw(scene, Kernel::reference, settings);
    const auto got = draw(scene, Kernel::fast, settings);
    REQUIRE(want.has_value());
    REQUIRE(got.has_value());
    CHECK(got->rays.traced() == want->rays.traced());
    float brightest = 0;
    for (std::size_t i = 0; i < want->film.pixels().size(); ++i) {
        CHECK(got->film.pixels()[i] == doctest::Approx(want->film.pixels()[i]));
        brightest = std::max(brightest, got->film.pixels()[i]);
    }
    CHECK(brightest > bright);
}

TEST_CASE("nor from one that got into it where such glass ends") {
    SceneBuilder b;
    const SolidIndex lens = b.solid(Sphere{{2, 0, 0}, 1}, glass(), IsotropicVolume{1.1});
    const SolidIndex between = b.solid(Sphere{{3.2, 0, 0}, 1}, matte(0.2), IsotropicVolume{1.1});
    const SolidIndex ball = b.solid(Sphere{{5, 0, 0}, 1.2}, matte(0.4), IsotropicVolume{1.1});
    const SolidIndex core = b.solid(Sphere{{4.1, 0, 0}, 0.25}, matte(0.9), IsotropicVolume{1.1});
    b.aggregate({lens, between, ball, core},
                {{lens, between}, {between, ball}, {core, between}, {core, ball}});
    check_seen(b.scene, 0.85F);
}

TEST_CASE("an opaque solid hides nothing from a ray in glass that displaces it") {
    SceneBuilder b;
    const SolidIndex ball = b.solid(Sphere{{5, 0, 0}, 2}, matte(0.2), IsotropicVolume{1.5});
    const SolidIndex lens = b.solid(Sphere{{4, 0, 0}, 2.5}, glass(), IsotropicVolume{1.1});
    const SolidIndex core = b.solid(Sphere{{4.5, 0, 0}, 0.5}, matte(0.9), IsotropicVolume{1.5});
    b.aggregate({ball, lens, core}, {{lens, ball}, {core, lens}, {core, ball}});
    check_seen(b.scene, 0.85F);
}

TEST_CASE("nothing under the cut level is followed") {
    LocalTexture faint = matte(0.5);
    faint.krg = {1e-4, 1e-4, 1e-4};
    CHECK(counts(ball_and_lamp(faint).scene).reflected == 0);
    CHECK(counts(ball_and_lamp(faint).scene, {.size = size, .exact = true}).reflected > 0);
}

TEST_CASE("a scene is drawn by a kernel without what it does not need") {
    using kernel::Features;
    const auto features = [](const Scene& scene) {
        const auto program = kernel::Program::compile(scene);
        REQUIRE(program);
        return kernel::usable_entries().back()->features_for(program->tables());
    };
    CHECK(features(ball_and_lamp(matte(0.5)).scene) ==
          Features{.state = false, .composites = false, .apart = false});
    CHECK(features(ball_and_lamp(glass(), IsotropicVolume{1.5}).scene) ==
          Features{.state = true, .composites = false, .apart = false});

    SceneBuilder many;
    std::vector<SolidIndex> balls;
    for (int i = 0; i < 30; ++i)
        balls.push_back(many.solid(Sphere{{5, 0.3 * i - 4.5, 0}, 0.1}, matte(0.5)));
    many.aggregate(balls);
    CHECK(features(many.scene) == Features{.state = false, .composites = false, .apart = true});
    balls.push_back(many.solid(Sphere{{9, 0, 0}, 1}, glass(), IsotropicVolume{1.5}));
    many.aggregate(balls);
    CHECK(features(many.scene) == Features{.state = true, .composites = true, .apart = true});

    SceneBuilder lens;
    const TextureIndex plain = lens.texture(matte(0.5));
    lens.solid(lens.textured(Intersection{
        {lens.textured(Sphere{{5, 0, 0}, 2}, plain), lens.textured(Sphere{{6, 0, 0}, 2}, plain)}}));
    CHECK(features(lens.scene).composites);
}

} // namespace
} // namespace fraja
