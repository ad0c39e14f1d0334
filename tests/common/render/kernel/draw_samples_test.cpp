// What a kernel tells of a sample beside its light: what it met, and what was cut.
#include "common/render/kernel/dispatch.hpp"
#include "common/render/kernel/render.hpp"
#include "common/render/render.hpp"
#include "tests/support/scene_builder.hpp"

#include <algorithm>
#include <cmath>
#include <doctest/doctest.h>
#include <memory>
#include <set>
#include <string>
#include <vector>

namespace fraja {
namespace {

struct Seen {
    std::vector<double> rgb, cut;
    std::vector<std::uint64_t> paths;
};

Seen see(const CompiledScene& scene, const std::vector<double>& x, const std::vector<double>& y,
         const RenderSettings& settings = {}) {
    const std::size_t n = x.size();
    Seen seen{std::vector<double>(3 * n), std::vector<double>(3 * n, 7.0),
              std::vector<std::uint64_t>(n, 7)};
    std::vector<std::uint32_t> rays(n);
    RenderControl control;
    REQUIRE(scene
                .draw_samples(settings,
                              {.x = x,
                               .y = y,
                               .rgb = seen.rgb,
                               .lost = {},
                               .cut = seen.cut,
                               .paths = seen.paths,
                               .rays = rays},
                              control)
                .has_value());
    return seen;
}

std::shared_ptr<const CompiledScene> compiled(const SceneBuilder& b) {
    return compile_scene(std::make_shared<const Scene>(b.scene), Kernel::fast);
}

/// Across the middle of the screen, none of them where edges of round numbers are.
constexpr std::size_t row_samples = 300;
std::vector<double> row_x() {
    std::vector<double> x;
    for (std::size_t i = 0; i < row_samples; ++i)
        x.push_back((static_cast<double>(i) + 0.377) / row_samples);
    return x;
}
const std::vector<double> row_y(row_samples, 0.513);

/// How often neighbours in a row differ in what they met; checks that it is where `red` jumps.
std::size_t borders(const Seen& seen, double jump) {
    std::size_t count = 0, wrong = 0;
    for (std::size_t i = 1; i < seen.paths.size(); ++i) {
        const bool differs = seen.paths[i] != seen.paths[i - 1];
        const double step = seen.rgb[3 * i] - seen.rgb[3 * i - 3];
        count += differs;
        wrong += differs != (std::abs(step) > jump);
    }
    CHECK(wrong == 0);
    return count;
}

/// Looks straight at a wall 10 away, 11 wide: of that form's texture.
SceneBuilder wall(Texture texture) {
    SceneBuilder b;
    b.scene.textures.push_back(std::move(texture));
    b.solid(b.textured(Plane{{5, 0, 0}, {-1, 0, 0}}, TextureIndex{0}));
    b.scene.world.lights = {PointLight{{-5, 3, 8}, {0.3, 0.3, 0.3}}};
    return b;
}
ChequeredTexture chequers(ChequeredTexture::Pattern pattern) {
    return {.pattern = pattern,
            .kd_one = {0.2, 0.2, 0.2},
            .kd_two = {0.7, 0.7, 0.7},
            .kr = {},
            .kt = {},
            .ns = 0,
            .step = 1,
            .x = 0.41,
            .y = 0.23};
}

TEST_CASE("samples in one field of a chequer met the same, and across its border not") {
    const Seen seen =
        see(*compiled(wall(chequers(ChequeredTexture::Pattern::damier))), row_x(), row_y);
    CHECK(borders(seen, 0.1) >= 9); // fields of 1, each in another colour than the next
    CHECK(std::set(seen.paths.begin(), seen.paths.end()).size() == borders(seen, 0.1) + 1);
    // Of three in a row, two are of one colour.
    for (const auto pattern :
         {ChequeredTexture::Pattern::hamier, ChequeredTexture::Pattern::mamier}) {
        const Seen other = see(*compiled(wall(chequers(pattern))), row_x(), row_y);
        CHECK(std::set(other.paths.begin(), other.paths.end()).size() >= 10);
        for (std::size_t i = 1; i < row_samples; ++i)
            if (std::abs(other.rgb[3 * i] - other.rgb[3 * i - 3]) > 0.1)
                CHECK(other.paths[i] != other.paths[i - 1]);
    }
}

TEST_CASE("no two fields of a chequer share a path") {
    std::set<std::uint64_t> paths;
    for (int i = 16; i < 28; ++i) { // the wall goes from field to field, and the camera with it
        SceneBuilder b = wall(chequers(ChequeredTexture::Pattern::damier));
        std::get<ChequeredTexture>(b.scene.textures[0]).y = -19.77;
        b.scene.world.lights.clear();
        std::get<Plane>(b.scene.forms[0]).origin.x = i + 0.9;
        std::get<HorizontalCamera>(b.scene.camera).origin.x = i - 9.1;
        const Seen seen = see(*compiled(b), row_x(), row_y);
        CHECK(borders(seen, 0.1) == 10);
        paths.insert(seen.paths.begin(), seen.paths.end());
    }
    CHECK(paths.size() == 12 * 11);
}

TEST_CASE("a plain wall is one path, however its light falls off") {
    const Seen seen = see(*compiled(wall(PlainTexture{matte(0.5)})), row_x(), row_y);
    CHECK(borders(seen, 0.1) == 0);
    CHECK(seen.rgb.front() != seen.rgb.back());
}

TEST_CASE("across a shadow's edge samples have met other lights") {
    SceneBuilder b = wall(PlainTexture{matte(0.5)});
    // Its shadow falls on the middle of the wall; the ball itself is out of view.
    b.aggregate({b.scene.world.solid, b.solid(Sphere{{2, 0, 20}, 2}, matte(0.5))});
    b.scene.world.lights = {DirectionalLight{{3, 0, -20}, {0.8, 0.8, 0.8}},
                            DirectionalLight{{1, 0, 0}, {0.1, 0.1, 0.1}}};
    CHECK(borders(see(*compiled(b), row_x(), row_y), 0.02) == 2);
}

TEST_CASE("across an object's edge samples have met other things, also of the same colour") {
    SceneBuilder b = wall(PlainTexture{matte(0.5)});
    b.scene.world.lights.clear();
    const auto plain = b.scene.world.solid;
    b.aggregate({plain, b.solid(Sphere{{3, 1, 0}, 1}, matte(0.5)),
                 b.solid(Sphere{{3, -2, 0}, 1}, matte(0.5))});
    const Seen seen = see(*compiled(b), row_x(), row_y);
    CHECK(std::ranges::count(seen.rgb, seen.rgb[0]) == 3 * row_samples);
    std::size_t changes = 0;
    for (std::size_t i = 1; i < row_samples; ++i)
        changes += seen.paths[i] != seen.paths[i - 1];
    CHECK(changes == 4);
    CHECK(std::set(seen.paths.begin(), seen.paths.end()).size() == 3);
}

TEST_CASE("what is seen in a mirror is part of what was met") {
    SceneBuilder b;
    const auto shiny = b.solid(Plane{{5, 0, 0}, {-1, 0, 0}}, mirror(0.9));
    b.aggregate({shiny, b.solid(Sphere{{-20, 0, 0}, 3}, matte(0.5))}); // behind the eye
    b.scene.world.background_light = {1, 1, 1};
    CHECK(borders(see(*compiled(b), row_x(), row_y), 0.1) == 2);
    CHECK(borders(see(*compiled(b), row_x(), row_y, {.depth = 1}), 0.1) == 0);
}

/// A ball before the sky, and its picture in a floor.
SceneBuilder ball_on_mirror() {
    SceneBuilder b;
    LocalTexture dim = mirror(0.3);
    dim.kd = {0.2, 0.2, 0.2};
    b.aggregate({b.solid(Sphere{{5, 1, 0}, 1.5}, dim),
                 b.solid(Plane{{0, 0, -3}, {0, 0, 1}}, mirror(0.6)),
                 b.solid(Sphere{{5, -2.5, 0}, 1}, glass(0.9), IsotropicVolume{1.4})});
    b.scene.world.background_light = {0.5, 0.5, 0.5};
    b.scene.world.lights = {PointLight{{-5, 3, 8}, {0.4, 0.4, 0.4}}};
    return b;
}

TEST_CASE("what a sample met does not depend on those that it is drawn with, nor on the CPU") {
    const auto scene = std::make_shared<const Scene>(ball_on_mirror().scene);
    std::vector<double> x, y;
    for (int i = 0; i < 24; ++i)
        for (int j = 0; j < 24; ++j)
            x.push_back((i + 0.377) / 24), y.push_back((j + 0.513) / 24);
    const RenderSettings settings{.error = 4};
    const Seen want = see(*compile_scene(scene, Kernel::fast), x, y, settings);
    CHECK(std::set(want.paths.begin(), want.paths.end()).size() > 10);
    for (const kernel::KernelEntry* entry : kernel::usable_entries()) {
        const auto by_entry = kernel::compile_for(*entry, scene);
        std::size_t other_paths = 0, other_cuts = 0;
        for (std::size_t i = 0; i < x.size(); ++i) {
            const Seen alone = see(*by_entry, {x[i]}, {y[i]}, settings);
            other_paths += alone.paths[0] != want.paths[i];
            other_cuts += !std::ranges::equal(alone.cut, std::span(want.cut).subspan(3 * i, 3));
        }
        CAPTURE(std::string(entry->isa));
        CHECK(other_paths == 0);
        CHECK(other_cuts == 0);
    }
}

TEST_CASE("rays below the cut level are told with their weight, unless all are followed") {
    SceneBuilder b;
    LocalTexture faint = matte(0.5);
    faint.krg = {1e-4, 2e-4, 3e-4};
    b.solid(Plane{{5, 0, 0}, {-1, 0, 0}}, faint);
    const auto scene = compiled(b);
    const auto cut = [&](const RenderSettings& settings) {
        return see(*scene, {0.3}, {0.4}, settings).cut;
    };
    CHECK(cut({}) == std::vector<double>{1e-4, 2e-4, 3e-4});
    CHECK(cut({.error = 1}) == std::vector<double>{1e-4, 2e-4, 3e-4});
    CHECK(cut({.exact = true}) == std::vector<double>(3, 0.0));
    CHECK(cut({.error = 1, .exact = true}) == std::vector<double>(3, 0.0));
    CHECK(cut({.depth = 1}) == std::vector<double>(3, 0.0)); // there is nothing that could be cut
}

TEST_CASE("a faint ray is cut sooner where a greater error is asked for") {
    SceneBuilder b;
    b.solid(Plane{{5, 0, 0}, {-1, 0, 0}}, mirror(1 / 765.0 * 3));
    const auto scene = compiled(b);
    CHECK(see(*scene, {0.3}, {0.4}, {.error = 1.4}).cut[0] == 0);
    CHECK(see(*scene, {0.3}, {0.4}, {.error = 1.6}).cut[0] == doctest::Approx(3 / 765.0));
}

} // namespace
} // namespace fraja
