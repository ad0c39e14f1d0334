// Whole pictures under stress: the same scene at other sizes and places, and optics that must
// cancel out.
#include "tests/support/draw.hpp"
#include "tests/support/scene_builder.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <doctest/doctest.h>
#include <numbers>
#include <span>
#include <string>
#include <utility>
#include <variant>

namespace fraja {
namespace {

#ifdef FRAJA_INSTRUMENTED // a build in which a ray is ten times as dear
constexpr Extent small{24, 18}, large{48, 36};
#else
constexpr Extent small{64, 48}, large{160, 120};
#endif

Drawn draw_fast(const Scene& scene, const RenderSettings& settings) {
    auto drawn = draw(scene, Kernel::fast, settings);
    REQUIRE(drawn.has_value());
    return std::move(*drawn);
}

// ------------------------------------------------------------------- moved, turned, scaled scenes

/// p -> scale * (p turned about z) + shift.
struct Motion {
    double scale = 1, angle = 0;
    Vec3 shift{};

    [[nodiscard]] Vec3 direction(Vec3 d) const {
        if (angle == 0)
            return d;
        const double c = std::cos(angle), s = std::sin(angle);
        return {c * d.x - s * d.y, s * d.x + c * d.y, d.z};
    }
    [[nodiscard]] Vec3 place(Vec3 p) const { return direction(p) * scale + shift; }
};

/// Every kind of form; glass in glass, mirrors, a drilled ball; no chequers.
Scene still_life(const Motion& m) {
    SceneBuilder b;
    const auto shiny = [](double r, double g, double blue) {
        return LocalTexture{.kd = {r, g, blue},
                            .krl = {0.5, 0.5, 0.5},
                            .krg = {0.3, 0.3, 0.3},
                            .ktg = {},
                            .ns = 20};
    };
    const auto sphere = [&](Vec3 center, double radius) {
        return Form{Sphere{m.place(center), m.scale * radius}};
    };
    const auto plane = [&](Vec3 origin, Vec3 normal) {
        return Form{Plane{m.place(origin), m.direction(normal)}};
    };
    const TextureIndex brown = b.texture(shiny(0.5, 0.3, 0.1));
    const TexturedFormIndex body = b.textured(sphere({1.5, 1.4, -0.3}, 0.9), brown);
    const TexturedFormIndex drill = b.textured(
        Cylinder{m.place({1.5, 1.4, 0}), m.direction({1, 0.5, 0.3}), m.scale * 0.4}, brown);
    const TexturedFormIndex drilled =
        b.textured(Intersection{{body, b.textured(Complement{drill})}});
    LocalTexture clear = glass(0.9);
    clear.krl = {0.3, 0.3, 0.3};
    clear.ns = 40;
    const SolidIndex outer = b.solid(sphere({0.2, -0.7, 0.1}, 1.1), clear, IsotropicVolume{1.5});
    const SolidIndex inner = b.solid(sphere({0.3, -0.6, 0.2}, 0.5), clear, IsotropicVolume{1.1});
    b.aggregate(
        {b.solid(plane({0, 0, -1.5}, {0.01, 0.02, 1}), shiny(0.3, 0.5, 0.4)),
         b.solid(Cone{m.place({4, 0.3, 2.5}), m.direction({0.1, 0, 1}), 0.4}, shiny(0.7, 0.2, 0.2)),
         outer, inner, b.solid(drilled, IsotropicVolume{1.0}),
         b.solid(sphere({2.5, -2.2, 0.4}, 0.8), shiny(0.2, 0.2, 0.7))},
        {{inner, outer}});
    b.scene.world.lights = {PointLight{m.place({-4, 3, 6}), {0.6, 0.6, 0.5}},
                            DirectionalLight{m.direction({1, -1, -1.5}), {0.3, 0.3, 0.4}}};
    b.scene.world.ambient_light = {0.2, 0.2, 0.2};
    b.scene.world.background_light = {0.3, 0.5, 0.8};
    b.scene.camera = HorizontalCamera{.origin = m.place({-5, 0.2, 0.5}),
                                      .direction = m.direction({1, 0.01, -0.05}),
                                      .focal = m.scale,
                                      .screen_width = m.scale,
                                      .screen_height = 0.75 * m.scale};
    return b.scene;
}

struct Difference {
    std::size_t jumps = 0; ///< pixels that see something else: at an edge rounding decides
    double most = 0;       ///< of the others
};
Difference difference(const Film& a, const Film& b, double jump) {
    const std::span<const float> ours = a.pixels(), theirs = b.pixels();
    REQUIRE(ours.size() == theirs.size());
    Difference d;
    for (std::size_t p = 0; p < ours.size(); p += 3) {
        double here = 0;
        for (std::size_t i = p; i < p + 3; ++i)
            here = std::max(here, std::abs(static_cast<double>(ours[i]) - double{theirs[i]}));
        if (here > jump)
            ++d.jumps;
        else
            d.most = std::max(d.most, here);
    }
    return d;
}

constexpr RenderSettings still_life_settings{.size = large, .depth = 12};

TEST_CASE("a picture of a scene 2^30 times as large or small has the same bits") {
    const Drawn want = draw_fast(still_life({}), still_life_settings);
    for (const double scale : {0x1p30, 0x1p-30}) {
        CAPTURE(scale);
        const Drawn got = draw_fast(still_life({.scale = scale}), still_life_settings);
        CHECK(std::ranges::equal(got.film.pixels(), want.film.pixels()));
        CHECK(got.rays == want.rays);
    }
}

// Pictures are floats: the least difference may show as a unit of theirs.
constexpr double float_unit = 0x1p-23;

TEST_CASE("scaled, moved and turned scenes look the same") {
    const Drawn want = draw_fast(still_life({}), still_life_settings);
    CHECK(want.rays.shaded > want.rays.camera); // there is much to see
    CHECK(want.rays.refracted > want.rays.camera / 10);
    const auto check = [&](const std::string& name, const Motion& motion, double mark) {
        CAPTURE(name);
        const Drawn got = draw_fast(still_life(motion), still_life_settings);
        const Difference d = difference(got.film, want.film, 1e-3);
        MESSAGE(name, ": ", d.most, " at most, ", d.jumps, " pixels at edges");
        CHECK(d.most <= mark + float_unit);
        CHECK(d.jumps <= want.film.pixels().size() / 3 / 2000);
    };
    check("1e9 as large", {.scale = 1e9}, 1e-9);
    check("1e-9 as large", {.scale = 1e-9}, 1e-9);
    check("moved by 4e3", {.shift = {4e3, -4e3, 4e3}}, 1e-8);
    check("turned by 1", {.angle = 1}, 1e-8);
    check("turned by pi / 2", {.angle = std::numbers::pi / 2}, 1e-8);
}

// ----------------------------------------------------------------------- optics that cancels out

/// The still life, seen through a clear ball right before the camera.
TEST_CASE("glass with the index of what is around it is not seen") {
    Scene bare = still_life({});
    bare.world.lights.clear(); // the glass would hide them, since every surface does
    SceneBuilder b;
    b.scene = bare;
    auto world = std::get<Aggregate>(bare.solids[as_size(bare.world.solid)]);
    world.members.push_back(b.solid(Sphere{{-2.6, 0, 0.2}, 1.3}, glass(), IsotropicVolume{1}));
    b.aggregate(world.members, world.priorities);
    const RenderSettings settings{.size = large, .depth = 60};
    const Drawn want = draw_fast(bare, settings), got = draw_fast(b.scene, settings);
    CHECK(got.rays.refracted > want.rays.refracted + large.width * large.height / 4);
    const Difference d = difference(got.film, want.film, 1e-3);
    MESSAGE(d.most, " at most, ", d.jumps, " pixels at edges");
    CHECK(d.most <= 1e-12 + float_unit);
    CHECK(d.jumps <= want.film.pixels().size() / 3 / 2000);
}

/// A camera inside a ball all of mirror: each ray is reflected until its depth is used up, and if
/// one escaped it would bring back light.
TEST_CASE("500 bounces in a mirror ball: no ray gets out, at any size and distance") {
    constexpr std::uint32_t depth = 501;
    for (const double scale : {1e-9, 1e-3, 1.0, 1e3, 1e9})
        for (const double away : {0.0, 1e3, 1e6}) {
            CAPTURE(scale);
            CAPTURE(away);
            const double at = away * scale;
            SceneBuilder b;
            b.aggregate({b.solid(Sphere{{at, at, at}, scale}, mirror())});
            b.scene.world.ambient_light = {};
            b.scene.world.background_light = {1, 1, 1};
            // From near the wall, with a wide view: straight rays, and such as go along the wall at
            // a twentieth of a radian.
            b.scene.camera = HorizontalCamera{.origin = {at - 0.999 * scale, at, at},
                                              .direction = {1, 0, 0},
                                              .focal = 0.001 * scale,
                                              .screen_width = 0.08 * scale,
                                              .screen_height = 0.06 * scale};
            const Drawn drawn = draw_fast(b.scene, {.size = small, .depth = depth});
            const std::uint64_t pixels = std::uint64_t{small.width} * small.height;
            CHECK(drawn.rays.camera == pixels);
            CHECK(drawn.rays.reflected == pixels * (depth - 1));
            CHECK(drawn.rays.shaded == pixels * depth);
            CHECK(std::ranges::all_of(drawn.film.pixels(), [](float f) { return f == 0; }));
        }
}

/// Three clear balls before a white background: everything is white.
Scene furnace() {
    SceneBuilder b;
    const SolidIndex one = b.solid(Sphere{{0, -0.4, 0.1}, 1}, glass(), IsotropicVolume{1.5});
    const SolidIndex two = b.solid(Sphere{{0.3, 0.5, -0.1}, 0.9}, glass(), IsotropicVolume{1.3});
    const SolidIndex three = b.solid(Sphere{{0.1, 0.1, 0}, 0.3}, glass(), IsotropicVolume{2.4});
    b.aggregate({one, two, three}, {{three, one}, {three, two}, {two, one}});
    b.scene.world.ambient_light = {};
    b.scene.world.background_light = {1, 1, 1};
    return b.scene;
}

TEST_CASE("a furnace of clear glass: what is missing to white is what was not followed") {
    const Scene scene = furnace();
    for (const std::uint32_t depth : {0u, 1u, 4u, 500u}) {
        CAPTURE(depth);
        const Drawn drawn =
            draw_fast(scene, {.size = small, .depth = depth, .aa = 2, .truncation = true});
        double lost = 0, missing = 0;
        for (std::size_t i = 0; i < drawn.truncated.size(); ++i)
            for (std::size_t c = 0; c < 3; ++c) {
                const double f = double{drawn.film.pixels()[3 * i + c]};
                CHECK(f <= 1);
                CHECK(std::abs(1 - f - double{drawn.truncated[i]}) <= 2 * float_unit);
                missing = std::max(missing, 1 - f), lost += double{drawn.truncated[i]} / 3;
            }
        lost /= static_cast<double>(drawn.truncated.size());
        MESSAGE("depth ", depth, ": ", missing, " missing at most, ", lost, " on the whole");
        CHECK(lost >= (depth == 0 ? 1 : depth == 500 ? 1e-6 : 1e-2));
        CHECK(lost <= (depth == 500 ? 1e-3 : 1 + 1e-9));
    }
}

TEST_CASE("nor is a picture another for being asked what it lacks") {
    const Scene scene = furnace();
    const RenderSettings plain{.size = small}, told{.size = small, .truncation = true};
    CHECK(std::ranges::equal(draw_fast(scene, plain).film.pixels(),
                             draw_fast(scene, told).film.pixels()));
    CHECK(draw_fast(scene, plain).truncated.empty());
}

} // namespace
} // namespace fraja
