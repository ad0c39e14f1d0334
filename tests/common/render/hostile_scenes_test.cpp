// Scenes from a seed: whatever their numbers, every picture is drawn, and of numbers.
#include "tests/common/render/kernel_under_test.hpp"
#include "tests/support/draw.hpp"
#include "tests/support/random_scene.hpp"
#include "tests/support/scene_builder.hpp"
#include "tests/support/seeds.hpp"

#include <cmath>
#include <doctest/doctest.h>

namespace fraja {
namespace {

/// Draws it and checks that every float is a number, not negative and not infinite. A priority may
/// be missing, since there are none.
void check_picture(const Scene& scene, const RenderSettings& settings) {
    const auto compiled = compile_scene(std::make_shared<const Scene>(scene), kernel_under_test);
    const auto drawn =
        draw(*compiled, settings, {0, 0, settings.size.width, settings.size.height}, 1);
    if (!drawn) {
        CHECK(drawn.error().code == ErrorCode::unresolved_overlap);
        return;
    }
    std::size_t wrong = 0;
    for (const float component : drawn->film.pixels())
        wrong += !std::isfinite(component) || component < 0;
    CHECK(wrong == 0);
}

/// From 1e-320 to 1e308, 0, and quite often something ordinary.
double any_magnitude(Rng& rng) {
    switch (rng.below(5)) {
    case 0:
        return 0;
    case 1:
        return std::pow(10.0, rng.between(-320, 308.2));
    case 2:
        return 1e154; // its square is nearly infinite
    default:
        return rng.unit();
    }
}
double any_number(Rng& rng) {
    return rng.below(2) ? any_magnitude(rng) : -any_magnitude(rng);
}
Vec3 any_vector(Rng& rng) {
    const double x = any_number(rng), y = any_number(rng);
    return {x, y, any_number(rng)};
}
Rgb any_colour(Rng& rng) {
    const double x = any_magnitude(rng), y = any_magnitude(rng);
    return {x, y, any_magnitude(rng)};
}

Form any_form(Rng& rng) {
    const Vec3 origin = any_vector(rng), direction = any_vector(rng);
    switch (rng.below(4)) {
    case 0:
        return Sphere{origin, any_number(rng)};
    case 1:
        return Plane{origin, direction};
    case 2:
        return Cylinder{origin, direction, any_number(rng)};
    default:
        return Cone{origin, direction, any_number(rng)};
    }
}

Texture any_texture(Rng& rng) {
    const auto ns =
        static_cast<std::int32_t>(static_cast<std::uint32_t>(rng.next() >> rng.below(64)));
    if (rng.below(2))
        return PlainTexture{{.kd = any_colour(rng),
                             .krl = any_colour(rng),
                             .krg = any_colour(rng),
                             .ktg = any_colour(rng),
                             .ns = ns}};
    return ChequeredTexture{.pattern = static_cast<ChequeredTexture::Pattern>(rng.below(3)),
                            .kd_one = any_colour(rng),
                            .kd_two = any_colour(rng),
                            .kr = any_colour(rng),
                            .kt = any_colour(rng),
                            .ns = ns,
                            .step = any_number(rng),
                            .x = any_number(rng),
                            .y = any_number(rng)};
}

Scene hostile_scene(Rng& rng) {
    SceneBuilder b;
    std::vector<TexturedFormIndex> forms;
    for (std::size_t i = 0; i < 6; ++i) {
        b.scene.textures.push_back(any_texture(rng));
        forms.push_back(b.textured(any_form(rng), static_cast<TextureIndex>(i)));
    }
    forms.push_back(b.textured(Complement{forms[0]}));
    forms.push_back(b.textured(Union{{forms[1], forms[2], forms[6]}}));
    forms.push_back(b.textured(Intersection{{forms[3], forms[4], forms[7]}}));
    std::vector<SolidIndex> members;
    std::vector<Priority> priorities;
    for (const TexturedFormIndex form : forms) {
        const auto member = b.solid(form, IsotropicVolume{any_number(rng)});
        for (const SolidIndex other : members)
            priorities.push_back({other, member});
        members.push_back(member);
    }
    b.aggregate(members, priorities);
    for (int i = 0; i < 2; ++i) {
        const Vec3 place = any_vector(rng);
        if (rng.below(2))
            b.scene.world.lights.push_back(PointLight{place, any_colour(rng)});
        else
            b.scene.world.lights.push_back(DirectionalLight{place, any_colour(rng)});
    }
    b.scene.world.ambient_light = any_colour(rng);
    b.scene.world.background_light = any_colour(rng);
    b.scene.camera = StereoCamera{{.origin = any_vector(rng),
                                   .direction = any_vector(rng),
                                   .focal = any_number(rng),
                                   .screen_width = any_number(rng),
                                   .screen_height = any_number(rng)},
                                  any_number(rng)};
    return b.scene;
}

TEST_CASE("a legal scene gives a picture of numbers") {
    for_each_seed(150, [](Rng& rng) {
        const Scene scene = random_scene(rng);
        check_picture(scene, {.size = {24, 18}, .depth = 6, .exact = rng.below(2) == 0});
    });
}

TEST_CASE("absurd numbers give a picture of numbers") {
    for_each_seed(2'000, [](Rng& rng) {
        check_picture(hostile_scene(rng), {.size = {8, 6}, .depth = 5, .exact = rng.below(2) == 0});
    });
}

TEST_CASE("huge and tiny scenes give a picture of numbers") {
    for_each_seed(60, [](Rng& rng) {
        const double scale = std::pow(10.0, rng.between(-170, 160));
        SceneBuilder b;
        b.scene.world.background_light = {0.5, 0.5, 0.5};
        b.scene.world.lights.push_back(PointLight{{-3 * scale, scale, 2 * scale}, {1, 1, 1}});
        const auto s = b.solid(Sphere{{0, 0, 0}, scale}, glass(0.9), IsotropicVolume{1.5});
        const auto c = b.solid(Cylinder{{0, 0, 0}, {0, 0, scale}, 0.5 * scale}, mirror(0.9));
        const auto k = b.solid(Cone{{0, 0, 0}, {0, scale, scale}, 0.4}, matte(0.5));
        b.aggregate({s, c, k}, {{c, s}, {k, s}, {k, c}});
        auto& camera = std::get<HorizontalCamera>(b.scene.camera);
        camera.origin = {-5 * scale, 0, 0};
        camera.focal = camera.screen_width = camera.screen_height = scale;
        check_picture(b.scene, {.size = {12, 12}, .depth = 8});
    });
}

} // namespace
} // namespace fraja
