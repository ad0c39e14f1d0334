// Where Raja's rendering dies (FORMAT.md, section 13), drawn as is meant.
#include "common/render/cut_level.hpp"
#include "tests/common/render/kernel_under_test.hpp"
#include "tests/support/draw.hpp"
#include "tests/support/scene_builder.hpp"

#include <cmath>
#include <doctest/doctest.h>
#include <limits>

namespace fraja {
namespace {

/// All of the picture's floats; checks that each is a number, and none negative or infinite.
std::vector<float> picture(const Scene& scene, const RenderSettings& settings) {
    const auto compiled = compile_scene(std::make_shared<const Scene>(scene), kernel_under_test);
    const auto drawn = draw(*compiled, settings);
    REQUIRE(drawn.has_value());
    for (const float component : drawn->film.pixels()) {
        REQUIRE(std::isfinite(component));
        REQUIRE(component >= 0);
    }
    return {drawn->film.pixels().begin(), drawn->film.pixels().end()};
}

TEST_CASE("glass met at exactly 90 degrees reflects what the limit says") {
    SceneBuilder b;
    b.scene.world.ambient_light = {};
    b.scene.world.background_light = {1, 1, 1};
    b.solid(Sphere{{0, 0, 0}, 1}, glass(), IsotropicVolume{1.5});
    const RenderSettings one_pixel{.size = {1, 1}, .depth = 2};
    // Of the light at the first surface 4 % is reflected background; the rest goes on inside,
    // which is dark at this depth.
    CHECK(picture(b.scene, one_pixel)[0] == doctest::Approx(0.04).epsilon(1e-6));
    // Straight through both surfaces, 96 % each.
    CHECK(picture(b.scene, {.size = {1, 1}, .depth = 3})[0] ==
          doctest::Approx(0.04 + 0.96 * 0.96).epsilon(1e-6));
}

TEST_CASE("the tip of a cone is drawn") {
    SceneBuilder b;
    b.scene.world.lights.push_back(PointLight{{-5, 3, 1}, {1, 1, 1}});
    b.scene.world.background_light = {0.5, 0.5, 0.5};
    LocalTexture texture = glass(0.5);
    texture.kd = texture.krl = texture.krg = {0.25, 0.25, 0.25};
    b.solid(Cone{{0, 0, 0}, {0, 0, 1}, 0.5}, texture, IsotropicVolume{1.5});
    // The middle ray of 5 x 5 passes through the tip. Whatever it finds there is shaded.
    const auto pixels = picture(b.scene, {.size = {5, 5}});
    CHECK(pixels[3 * 12] > 0.2f);
}

TEST_CASE("cones of no angle and spheres and cylinders of no radius are drawn") {
    for (const Form& form :
         {Form{Cone{{0, 0, 0}, {0, 0, 1}, 0}}, Form{Sphere{{0, 0, 0}, 0}},
          Form{Cylinder{{0, 0, 0}, {0, 0, 1}, 0}}, Form{Cone{{0, 0, 0}, {1, 0, 0}, 0}},
          Form{Cone{{0, 0, 0}, {1, 0, 0}, std::acos(0.0)}}}) {
        SceneBuilder b;
        b.scene.world.lights.push_back(PointLight{{-5, 3, 1}, {1, 1, 1}});
        b.solid(form, glass(), IsotropicVolume{1.5});
        picture(b.scene, {.size = {9, 9}});
    }
}

TEST_CASE("coincident surfaces within a form do not stop the picture") {
    SceneBuilder b;
    b.scene.world.background_light = {0.5, 0.5, 0.5};
    const auto texture = b.texture(glass());
    const Sphere sphere{{0.1, 0.2, 0.3}, 0.7};
    std::vector<TexturedFormIndex> same;
    for (int i = 0; i < 4; ++i)
        same.push_back(b.textured(sphere, texture));
    const auto common = b.textured(Intersection{same});
    const auto hollow = b.textured(
        Intersection{{common, b.textured(Complement{b.textured(Union{{same[0], same[1]}})})}});
    b.solid(b.textured(Union{{common, hollow, same[2]}}), IsotropicVolume{1.5});
    picture(b.scene, {.size = {64, 64}, .depth = 6});
}

TEST_CASE("a negative sharpness draws no highlight where Raja's is 0 / 0") {
    SceneBuilder b;
    LocalTexture texture = matte(0.5);
    texture.ns = -3;
    b.scene.world.ambient_light = {0.5, 0.5, 0.5};
    // The light at the eye's height to the side: mirrored at a right angle to the ray.
    b.scene.world.lights.push_back(DirectionalLight{{0, 0, -1}, {1, 1, 1}});
    b.solid(Plane{{0, 0, 0}, {-1, 0, 0}}, texture);
    CHECK(picture(b.scene, {.size = {1, 1}})[0] == 0.25f);
}

TEST_CASE("a colour that no light has is cut at 0 with exact, and never kept alive without") {
    World world;
    world.ambient_light = {0.5, 0.25, 0};
    world.lights.push_back(PointLight{{}, {0.5, 0.75, 0}});
    CHECK(cut_level(world, {.exact = true}) == Rgb{0, 0, 0});
    const Rgb cut = cut_level(world, {});
    CHECK(cut.x == 1.0 * (1 / 765.0));
    CHECK(cut.y == 1.0 * (1 / 765.0));
    CHECK(cut.z == std::numeric_limits<double>::infinity());
}

TEST_CASE("the cut level counts the brighter of ambient and background light") {
    World world;
    world.ambient_light = {0.5, 0.25, 1};
    world.background_light = {0.25, 0.5, 1};
    const Rgb cut = cut_level(world, {});
    CHECK(cut == Rgb{2 * (1 / 765.0), 2 * (1 / 765.0), 1 / 765.0});
}

TEST_CASE("a ray of no length looks along the camera") {
    SceneBuilder b;
    b.scene.world.background_light = {0.25, 0.25, 0.25};
    auto& camera = std::get<HorizontalCamera>(b.scene.camera);
    camera.focal = 0;
    b.solid(Sphere{{0, 0, 0}, 1}, matte(1));
    const auto pixels = picture(b.scene, {.size = {3, 3}});
    CHECK(pixels[3 * 4] == 1.0f);
    CHECK(pixels[0] == 0.25f); // the others look sideways
}

TEST_CASE("a camera that looks straight down draws something") {
    SceneBuilder b;
    b.scene.world.background_light = {0.25, 0.25, 0.25};
    auto& camera = std::get<HorizontalCamera>(b.scene.camera);
    camera.origin = {0, 0, 5};
    camera.direction = {0, 0, -1};
    b.solid(Sphere{{0, 0, 0}, 0.5}, matte(1));
    const auto pixels = picture(b.scene, {.size = {3, 3}});
    CHECK(pixels[3 * 4] == 1.0f);
    CHECK(pixels[0] == 0.25f);
}

TEST_CASE("a light on the surface it would light is no light") {
    SceneBuilder b;
    b.scene.world.lights.push_back(PointLight{{-1, 0, 0}, {1, 1, 1}});
    b.solid(Sphere{{0, 0, 0}, 1}, matte(0.5));
    CHECK(picture(b.scene, {.size = {1, 1}})[0] == 0.5f);
}

} // namespace
} // namespace fraja
