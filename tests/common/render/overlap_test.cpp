// Where solids overlap: priorities, and what is said when one is missing. FORMAT.md, section 8.6.
#include "common/scene/raj_reader.hpp"
#include "tests/common/render/kernel_under_test.hpp"
#include "tests/support/draw.hpp"
#include "tests/support/scene_builder.hpp"

#include <doctest/doctest.h>
#include <filesystem>

namespace fraja {
namespace {

Result<RenderedTile> draw_pixel(const Scene& scene, std::uint32_t depth = 5) {
    RenderControl control;
    return compile_scene(std::make_shared<const Scene>(scene), kernel_under_test)
        ->render_tile({.size = {1, 1}, .depth = depth}, {0, 0, 1, 1}, control);
}

float red_of(const Scene& scene, std::uint32_t depth = 5) {
    const auto pixel = draw_pixel(scene, depth);
    REQUIRE(pixel.has_value());
    return pixel->tile.rgb[0];
}

constexpr Sphere ball{{0, 0, 0}, 1};         // met at x = -1 and 1
constexpr Sphere nearer_ball{{-1, 0, 0}, 1}; // met at x = -2 and 0

TEST_CASE("a missing priority that a ray needs is an error that names both solids") {
    const auto scene = read_raj_file(std::filesystem::path(FRAJA_SOURCE_DIR) /
                                     "scenes/overlap_without_priority.raj");
    REQUIRE(scene.has_value());
    const auto compiled = compile_scene(std::make_shared<const Scene>(*scene), kernel_under_test);
    const auto drawn = draw(*compiled, {.size = {320, 240}});
    REQUIRE(!drawn.has_value());
    CHECK(drawn.error().code == ErrorCode::unresolved_overlap);
    CHECK(
        drawn.error().message ==
        "solids @a (line 12) and @c (line 14) overlap where a ray passes and neither has priority "
        "over the other; add '@a >> @c' or '@c >> @a' to priorities");
}

TEST_CASE("solids without labels are named by their place") {
    SceneBuilder b;
    const auto s = b.solid(ball, glass(), IsotropicVolume{1.5});
    const auto t = b.solid(nearer_ball, glass(), IsotropicVolume{1.2});
    b.aggregate({s, t});
    b.scene.solid_names[0].line = 12;
    auto pixel = draw_pixel(b.scene);
    REQUIRE(!pixel.has_value());
    CHECK(pixel.error().message.find("solids the one at line 12 and number 1 overlap") == 0);
    CHECK(pixel.error().message.find("give each a label") != std::string::npos);

    b.scene.solid_names.clear();
    pixel = draw_pixel(b.scene);
    REQUIRE(!pixel.has_value());
    CHECK(pixel.error().message.find("solids number 0 and number 1 overlap") == 0);
}

TEST_CASE("an overlap that no ray resolves needs no priority") {
    SceneBuilder b; // opaque balls: no ray gets into the space they share
    const auto s = b.solid(ball, matte(0.25));
    const auto t = b.solid(nearer_ball, matte(0.5));
    b.aggregate({s, t});
    CHECK(red_of(b.scene) == 0.5f);
}

TEST_CASE("the solid with priority is seen where two overlap") {
    // From within a clear ball (the camera's screen is at x = -4) towards a matte one inside it.
    SceneBuilder b;
    const auto s = b.solid(ball, matte(0.5), {}, "@s");
    const auto around = b.solid(Sphere{{0, 0, 0}, 100}, matte(0.25), {}, "@around");
    b.aggregate({s, around}, {{s, around}});
    CHECK(red_of(b.scene) == 0.5f);
    b.aggregate({s, around}, {{around, s}});
    CHECK(red_of(b.scene) == 0.25f);
    b.aggregate({s, around}); // without a relation to what the ray is in, the ball is skipped
    CHECK(red_of(b.scene) == 0.25f);
}

TEST_CASE("with priorities over each other, what is entered displaces") {
    SceneBuilder b;
    const auto s = b.solid(ball, matte(0.5));
    const auto around = b.solid(Sphere{{0, 0, 0}, 100}, matte(0.25));
    b.aggregate({s, around}, {{s, around}, {around, s}});
    CHECK(red_of(b.scene) == 0.5f);
}

TEST_CASE("a priority over oneself, of strangers, or given twice changes nothing") {
    SceneBuilder b;
    const auto s = b.solid(ball, matte(0.5));
    const auto stranger = b.solid(Sphere{{0, 0, 0}, 3}, matte(1));
    const auto around = b.solid(Sphere{{0, 0, 0}, 100}, matte(0.25));
    b.aggregate({s, around}, {{s, s}, {s, around}, {stranger, s}, {s, around}, {around, around}});
    CHECK(red_of(b.scene) == 0.5f);
}

TEST_CASE("a solid listed twice is one solid") {
    SceneBuilder b;
    const auto s = b.solid(ball, glass(), IsotropicVolume{1.5});
    b.aggregate({s, s, s});
    const auto thrice = draw_pixel(b.scene);
    b.aggregate({s});
    const auto once = draw_pixel(b.scene);
    REQUIRE(thrice.has_value());
    REQUIRE(once.has_value());
    CHECK(thrice->tile == once->tile);
    CHECK(thrice->rays == once->rays);
}

TEST_CASE("priorities in a circle are an error that says so") {
    SceneBuilder b;
    const auto r = b.solid(Sphere{{0, 0, 0}, 100}, matte(0.25), {}, "@r");
    const auto s = b.solid(Sphere{{0, 0, 0}, 101}, matte(0.25), {}, "@s");
    const auto t = b.solid(Sphere{{0, 0, 0}, 102}, matte(0.25), {}, "@t");
    b.aggregate({r, s, t}, {{r, s}, {s, t}, {t, r}});
    const auto pixel = draw_pixel(b.scene);
    REQUIRE(!pixel.has_value());
    CHECK(pixel.error().code == ErrorCode::unresolved_overlap);
    CHECK(pixel.error().message.find("solids @t and @r overlap, along with others") == 0);
    CHECK(pixel.error().message.find("circle") != std::string::npos);
}

TEST_CASE("two solids that end at one instant, without a priority, are an error that names both") {
    SceneBuilder b;
    const auto s = b.solid(Sphere{{0, 1, 0}, 2}, glass(), IsotropicVolume{1.5}, "@s");
    const auto t = b.solid(Sphere{{0, -1, 0}, 2}, glass(), IsotropicVolume{1.5}, "@t");
    b.aggregate({s, t});
    b.scene.camera = HorizontalCamera{{-0.5, 0, 0}, {1, 0, 0}, 0.1, 0.1, 0.1};
    const auto pixel = draw_pixel(b.scene);
    REQUIRE(!pixel.has_value());
    CHECK(pixel.error().code == ErrorCode::unresolved_overlap);
    CHECK(pixel.error().message.find("@s") != std::string::npos);
    CHECK(pixel.error().message.find("@t") != std::string::npos);
}

TEST_CASE("of coincident surfaces the first member is seen") {
    SceneBuilder b;
    const auto s = b.solid(ball, matte(0.5));
    const auto t = b.solid(ball, matte(0.25));
    b.aggregate({s, t});
    CHECK(red_of(b.scene) == 0.5f);
    b.aggregate({t, s});
    CHECK(red_of(b.scene) == 0.25f);
}

TEST_CASE("a solid as a volume has the solid's index") {
    const auto picture = [](bool through_solid) {
        SceneBuilder b;
        b.scene.world.background_light = {1, 0.5, 0.25};
        b.scene.world.ambient_light = {};
        const auto jelly = b.solid(Sphere{{50, 0, 0}, 1}, glass(), IsotropicVolume{1.5});
        const auto chain = b.solid(Sphere{{60, 0, 0}, 1}, glass(), Volume{jelly});
        const Volume volume = through_solid ? Volume{chain} : Volume{IsotropicVolume{1.5}};
        const auto s = b.solid(Sphere{{0, 0.3, 0.2}, 1}, glass(), volume);
        b.aggregate({s});
        RenderControl control;
        const auto tile = compile_scene(std::make_shared<const Scene>(b.scene), kernel_under_test)
                              ->render_tile({.size = {16, 16}}, {0, 0, 16, 16}, control);
        REQUIRE(tile.has_value());
        return tile->tile;
    };
    CHECK(picture(true) == picture(false));
}

TEST_CASE("an aggregate as a volume has the index of what fills the point, else the ambient one") {
    // What the front of a ball reflects depends on its index. The aggregate that is its volume is
    // two balls around `filled`.
    enum class What { number, aggregate };
    const auto reflected = [](What what, double index, Vec3 filled) {
        SceneBuilder b;
        b.scene.world.ambient_light = {};
        b.scene.world.background_light = {1, 1, 1};
        const auto dense = b.solid(Sphere{filled, 3}, glass(), IsotropicVolume{1.5});
        const auto denser = b.solid(Sphere{filled, 2}, glass(), IsotropicVolume{3});
        const Volume set = b.aggregate({dense, denser}, {{dense, denser}});
        b.solid(ball, glass(), what == What::aggregate ? set : IsotropicVolume{index});
        RenderControl control;
        const auto tile = compile_scene(std::make_shared<const Scene>(b.scene), kernel_under_test)
                              ->render_tile({.size = {8, 8}, .depth = 2}, {3, 3, 1, 1}, control);
        REQUIRE(tile.has_value());
        return tile->tile.rgb[0];
    };
    CHECK(reflected(What::aggregate, 0, {0, 0, 0}) == reflected(What::number, 1.5, {0, 0, 0}));
    CHECK(reflected(What::aggregate, 0, {0, 99, 0}) == reflected(What::number, 1, {0, 0, 0}));
    CHECK(reflected(What::number, 1.5, {}) > reflected(What::number, 1, {}));
}

TEST_CASE("the world's volume may be a solid") {
    SceneBuilder b;
    b.scene.world.ambient_light = {};
    b.scene.world.background_light = {1, 1, 1};
    const auto sea = b.solid(Sphere{{0, 0, 0}, 50}, glass(), IsotropicVolume{1.5});
    const auto set = b.aggregate({sea});
    b.solid(ball, glass(), IsotropicVolume{1.5});
    b.scene.world.ambient_volume = set;
    CHECK(red_of(b.scene, 3) == 1.0f); // index-matched: nothing is reflected
}

} // namespace
} // namespace fraja
