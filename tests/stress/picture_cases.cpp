#include "tests/stress/picture_cases.hpp"

#include "common/base/assert.hpp"
#include "common/render/kernel/dispatch.hpp"
#include "common/render/kernel/render.hpp"
#include "tests/support/draw.hpp"
#include "tests/support/hostile_scene.hpp"
#include "tests/support/scene_builder.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <numbers>
#include <span>
#include <string>
#include <utility>
#include <variant>

namespace fraja::stress {
namespace {

Drawn draw_fast(const Scene& scene, const RenderSettings& settings) {
    auto drawn = draw(scene, Kernel::fast, settings);
    FRAJA_ASSERT(drawn.has_value());
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

/// Pictures are floats: the least difference may show as a unit of theirs.
constexpr double float_unit = 0x1p-23;

/// At an edge rounding decides what a pixel sees: one in so many may.
constexpr std::size_t pixels_per_jump = 2000;

class PictureCases {
public:
    PictureCases(Extent small, Extent large, std::uint64_t scenes)
        : small_(small), large_(large), scenes_(scenes) {}

    std::vector<Figure> run() {
        powers_of_two();
        motions();
        index_matched();
        mirror_ball();
        for (const std::uint32_t depth : {0u, 1u, 4u, 500u})
            furnace_of(depth);
        absurd_scenes();
        boxes();
        return std::move(figures_);
    }

private:
    void add(std::string name, double value, double mark) {
        figures_.push_back({std::move(name), value, mark});
    }
    void add(const std::string& name, const Difference& d, double mark) {
        add(name + ": greatest difference", d.most, mark + float_unit);
        add(name + ": pixels at edges", static_cast<double>(d.jumps),
            static_cast<double>(large_.pixel_count() / pixels_per_jump));
    }
    [[nodiscard]] RenderSettings settings() const { return {.size = large_, .depth = 12}; }

    void powers_of_two() {
        const Drawn want = draw_fast(still_life({}), settings());
        FRAJA_ASSERT(want.rays.shaded > want.rays.camera); // there is much to see
        FRAJA_ASSERT(want.rays.refracted > want.rays.camera / 10);
        for (const double scale : {0x1p30, 0x1p-30}) {
            const Drawn got = draw_fast(still_life({.scale = scale}), settings());
            add(scale > 1 ? "scaled by 2^30: floats that differ" : "scaled by 2^-30: likewise",
                floats_that_differ(got.film, want.film), 0);
        }
    }

    void motions() {
        const Drawn want = draw_fast(still_life({}), settings());
        const auto compare = [&](const std::string& name, const Motion& motion, double mark) {
            add(name, difference(draw_fast(still_life(motion), settings()).film, want.film, 1e-3),
                mark);
        };
        compare("scaled by 1e9", {.scale = 1e9}, 1e-9);
        compare("scaled by 1e-9", {.scale = 1e-9}, 1e-9);
        compare("moved by 4e3", {.shift = {4e3, -4e3, 4e3}}, 1e-8);
        compare("turned by 1", {.angle = 1}, 1e-8);
        compare("turned by pi / 2", {.angle = std::numbers::pi / 2}, 1e-8);
    }

    /// The still life, seen through a clear ball right before the camera.
    void index_matched() {
        Scene bare = still_life({});
        bare.world.lights.clear(); // the glass would hide them, since every surface does
        SceneBuilder b;
        b.scene = bare;
        auto world = std::get<Aggregate>(bare.solids[as_size(bare.world.solid)]);
        world.members.push_back(b.solid(Sphere{{-2.6, 0, 0.2}, 1.3}, glass(), IsotropicVolume{1}));
        b.aggregate(world.members, world.priorities);
        const RenderSettings deep{.size = large_, .depth = 60};
        const Drawn want = draw_fast(bare, deep), got = draw_fast(b.scene, deep);
        FRAJA_ASSERT(got.rays.refracted > want.rays.refracted + large_.pixel_count() / 4);
        add("index-matched glass", difference(got.film, want.film, 1e-3), 1e-12);
    }

    /// A camera inside a ball all of mirror: each ray is reflected until its depth is used up, and
    /// if one escaped it would bring back light.
    void mirror_ball() {
        constexpr std::uint32_t depth = 501;
        std::uint64_t lost = 0;
        for (const double scale : {1e-9, 1e-3, 1.0, 1e3, 1e9})
            for (const double away : {0.0, 1e3, 1e6}) {
                const double at = away * scale;
                SceneBuilder b;
                b.aggregate({b.solid(Sphere{{at, at, at}, scale}, mirror())});
                b.scene.world.ambient_light = {};
                b.scene.world.background_light = {1, 1, 1};
                // From near the wall, with a wide view.
                b.scene.camera = HorizontalCamera{.origin = {at - 0.999 * scale, at, at},
                                                  .direction = {1, 0, 0},
                                                  .focal = 0.001 * scale,
                                                  .screen_width = 0.08 * scale,
                                                  .screen_height = 0.06 * scale};
                const Drawn drawn = draw_fast(b.scene, {.size = small_, .depth = depth});
                lost += small_.pixel_count() * depth - drawn.rays.shaded;
                lost += static_cast<std::uint64_t>(
                    std::ranges::count_if(drawn.film.pixels(), [](float f) { return f != 0; }));
            }
        add("500 bounces in 15 mirror balls: rays lost", static_cast<double>(lost), 0);
    }

    /// Nothing is absorbed: what is missing to white is what was not followed.
    void furnace_of(std::uint32_t depth) {
        const Drawn drawn =
            draw_fast(furnace(), {.size = small_, .depth = depth, .aa = 2, .truncation = true});
        double above = 0, unexplained = 0;
        for (std::size_t i = 0; i < drawn.truncated.size(); ++i)
            for (std::size_t c = 0; c < 3; ++c) {
                const double f = double{drawn.film.pixels()[3 * i + c]};
                above = std::max(above, f - 1);
                unexplained = std::max(unexplained, std::abs(1 - f - double{drawn.truncated[i]}));
            }
        const std::string name = "furnace, depth " + std::to_string(depth);
        add(name + ": above 1", above, 0);
        add(name + ": missing, not explained by truncation", unexplained, 2 * float_unit);
    }

    void absurd_scenes() {
        Rng rng(1);
        std::uint64_t wrong = 0, drawn_scenes = 0;
        for (std::uint64_t i = 0; i < scenes_; ++i) {
            const Scene scene = hostile_scene(rng);
            const auto drawn =
                draw(scene, Kernel::fast,
                     {.size = {8, 6}, .depth = 5, .exact = rng.below(2) == 0, .truncation = true});
            if (!drawn) // no priority was given
                continue;
            ++drawn_scenes;
            const auto is_wrong = [](float f) { return !std::isfinite(f) || f < 0; };
            wrong +=
                static_cast<std::uint64_t>(std::ranges::count_if(drawn->film.pixels(), is_wrong) +
                                           std::ranges::count_if(drawn->truncated, is_wrong));
        }
        FRAJA_ASSERT(drawn_scenes > scenes_ / 2);
        add("absurd numbers: floats that are no number", static_cast<double>(wrong), 0);
    }

    /// A heap of balls, by the hierarchy and one by one.
    void boxes() {
        for (const double offset : {0.0, 1e3, 1e5, 1e7, 1e9}) {
            Rng rng(1);
            SceneBuilder b;
            std::vector<SolidIndex> members;
            const Vec3 place{offset, -offset / 3, offset / 7};
            LocalTexture shiny = mirror(0.5);
            shiny.kd = {0.3, 0.3, 0.3};
            for (int i = 0; i < 500; ++i) {
                const double x = rng.between(-4, 4), y = rng.between(-4, 4);
                const Vec3 center{x, y, rng.between(-3, 3)};
                members.push_back(b.solid(Sphere{place + center, rng.between(0.05, 0.4)}, shiny));
            }
            b.aggregate(members);
            b.scene.world.lights = {PointLight{place + Vec3{-6, -3, 9}, {0.6, 0.5, 0.7}}};
            b.scene.camera = HorizontalCamera{.origin = place + Vec3{-9, 0, 0},
                                              .direction = {1, 0, 0},
                                              .focal = 1,
                                              .screen_width = 1,
                                              .screen_height = 0.75};
            const auto scene = std::make_shared<const Scene>(b.scene);
            const auto by_list = kernel::compile_for(*kernel::usable_entries().back(), scene,
                                                     {.spheres_apart_min = members.size() + 1});
            const auto want = draw(*by_list, {.size = large_});
            FRAJA_ASSERT(want.has_value() && want->rays.reflected > 0);
            add("float boxes, offset " + std::to_string(static_cast<std::uint64_t>(offset)) +
                    ": floats that differ",
                floats_that_differ(draw_fast(b.scene, {.size = large_}).film, want->film), 0);
        }
    }

    static double floats_that_differ(const Film& a, const Film& b) {
        double count = 0;
        for (std::size_t i = 0; i < a.pixels().size(); ++i)
            count += a.pixels()[i] == b.pixels()[i] ? 0 : 1;
        return count;
    }

    Extent small_, large_;
    std::uint64_t scenes_;
    std::vector<Figure> figures_;
};

} // namespace

std::vector<Figure> picture_figures(Extent small, Extent large, std::uint64_t absurd_scenes) {
    return PictureCases(small, large, absurd_scenes).run();
}

} // namespace fraja::stress
