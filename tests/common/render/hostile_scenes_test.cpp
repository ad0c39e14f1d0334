// Scenes from a seed: whatever their numbers, every picture is drawn, and of numbers.
#include "tests/common/render/kernel_under_test.hpp"
#include "tests/support/draw.hpp"
#include "tests/support/hostile_scene.hpp"
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
    const Film& film = drawn->film;
    std::size_t wrong = 0;
    for (const auto floats : {film.pixels(), film.samples(), film.error()})
        for (const float component : floats)
            wrong += !std::isfinite(component) || component < 0;
    CHECK(wrong == 0);
    for (const float samples : film.samples())
        CHECK((samples >= 4 && samples <= static_cast<float>(settings.max_samples)));
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

TEST_CASE("so do absurd spheres that are many enough for a hierarchy") {
    for_each_seed(200, [](Rng& rng) {
        SceneBuilder b;
        std::vector<SolidIndex> members;
        for (int i = 0; i < 40; ++i) {
            const Vec3 center = rng.below(3) == 0 ? Vec3{i % 2 ? 1e160 : -1e160,
                                                         i % 4 < 2 ? 1e160 : -1e160, 5.0 + i}
                                                  : detail::any_vector(rng);
            const double radius = rng.below(3) == 0 ? 1e155 : detail::any_number(rng);
            members.push_back(b.solid(Sphere{center, radius}, mirror(0.5)));
        }
        b.aggregate(members);
        check_picture(b.scene, {.size = {8, 6}, .depth = 3});
    });
}

TEST_CASE("absurd numbers give samples and errors that are numbers") {
    for_each_seed(400, [](Rng& rng) {
        check_picture(hostile_scene(rng), {.size = {8, 6},
                                           .depth = 5,
                                           .error = rng.below(2) == 0 ? 1.0 : 1e-3,
                                           .max_samples = 16,
                                           .filter = rng.below(2) == 0 ? Filter::box : Filter::tent,
                                           .exact = rng.below(4) == 0});
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
