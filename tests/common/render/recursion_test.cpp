// Paths far deeper than a thread's stack: sums whose every bit is known.
#include "common/render/render.hpp"
#include "tests/common/render/kernel_under_test.hpp"
#include "tests/support/scene_builder.hpp"

#include <doctest/doctest.h>

namespace fraja {
namespace {

/// Two perfect mirrors face to face, each of which also shines with `shine`.
Scene two_mirrors(double shine) {
    SceneBuilder b;
    LocalTexture texture = mirror();
    texture.kd = {shine, shine, shine};
    const auto right = b.solid(Plane{{1, 0, 0}, {-1, 0, 0}}, texture);
    const auto left = b.solid(Plane{{-6, 0, 0}, {1, 0, 0}}, texture);
    b.aggregate({right, left});
    return b.scene;
}

Result<RenderedTile> draw_pixel(const Scene& scene, const RenderSettings& settings) {
    RenderControl control;
    return compile_scene(std::make_shared<const Scene>(scene), kernel_under_test)
        ->render_tile(settings, {0, 0, 1, 1}, control);
}

TEST_CASE("a path of 100,000 bounces adds up the light of each") {
    constexpr double shine = 0x1p-20; // sums of it are exact
    for (const bool exact : {false, true}) {
        const auto pixel =
            draw_pixel(two_mirrors(shine), {.size = {1, 1}, .depth = 100'000, .exact = exact});
        REQUIRE(pixel.has_value());
        CHECK(pixel->tile.rgb[0] == static_cast<float>(100'000 * shine));
        CHECK(pixel->rays.camera == 1);
        CHECK(pixel->rays.reflected == 99'999);
    }
}

TEST_CASE("a path that hardly ends is cut short, and it is said") {
    constexpr std::uint32_t most = 1 << 20;
    for (const double shine : {0.0, 0x1p-20}) {
        CAPTURE(shine);
        const auto pixel = draw_pixel(two_mirrors(shine), {.size = {1, 1}, .depth = 1'100'000});
        if constexpr (kernel_under_test == Kernel::fast) {
            REQUIRE(pixel.has_value());
            CHECK(pixel->rays.traced() == most);
            CHECK(pixel->rays.truncated_pixels == 1);
            CHECK(pixel->tile.rgb[0] == static_cast<float>(most * shine));
        } else if (shine == 0) { // the reference remembers nothing of such bounces
            REQUIRE(pixel.has_value());
            CHECK(pixel->rays.traced() == 1'100'000);
        } else {
            REQUIRE(!pixel.has_value());
            CHECK(pixel.error().code == ErrorCode::limit_exceeded);
            CHECK(pixel.error().message.find("depth") != std::string::npos);
        }
    }
}

TEST_CASE("a glass in a row of glasses is seen through all of them") {
    // Index-matched planes: each lets half of the light through and shines a little.
    SceneBuilder b;
    constexpr int planes = 300;
    std::vector<SolidIndex> members;
    LocalTexture texture = glass();
    texture.kd = {0x1p-12, 0x1p-12, 0x1p-12};
    for (int i = 0; i < planes; ++i) // behind one another, each seen from its inside
        members.push_back(b.solid(Plane{{static_cast<double>(i), 0, 0}, {1, 0, 0}}, texture));
    std::vector<Priority> priorities;
    for (std::size_t i = 0; i < members.size(); ++i)
        for (std::size_t j = i + 1; j < members.size(); ++j)
            priorities.push_back({members[i], members[j]});
    b.aggregate(members, priorities);
    const auto pixel = draw_pixel(b.scene, {.size = {1, 1}, .depth = 100'000});
    REQUIRE(pixel.has_value());
    CHECK(pixel->tile.rgb[0] == static_cast<float>(planes * 0x1p-12));
    CHECK(pixel->rays.refracted == planes);
}

} // namespace
} // namespace fraja
