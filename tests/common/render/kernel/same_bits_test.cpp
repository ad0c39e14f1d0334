// One hash of a picture, whatever draws it: instruction sets, tiles, the hierarchy or a list.
#include "common/render/kernel/dispatch.hpp"
#include "common/render/kernel/render.hpp"
#include "tests/support/draw.hpp"
#include "tests/support/random_scene.hpp"
#include "tests/support/scene_builder.hpp"
#include "tests/support/seeds.hpp"

#include <algorithm>
#include <cmath>
#include <doctest/doctest.h>
#include <memory>
#include <thread>

namespace fraja {
namespace {

#ifdef FRAJA_INSTRUMENTED
constexpr std::uint64_t scenes = 20;
#else
constexpr std::uint64_t scenes = 200;
#endif

std::vector<float> pixels_of(const CompiledScene& scene, const RenderSettings& settings,
                             Extent tile) {
    Film film(settings.size, {0, 0, settings.size.width, settings.size.height});
    RenderControl control;
    for (std::uint32_t y = 0; y < settings.size.height; y += tile.height)
        for (std::uint32_t x = 0; x < settings.size.width; x += tile.width) {
            const auto drawn =
                scene.render_tile(settings,
                                  {x, y, std::min(tile.width, settings.size.width - x),
                                   std::min(tile.height, settings.size.height - y)},
                                  control);
            REQUIRE(drawn.has_value());
            film.place(drawn->tile);
        }
    const auto pixels = film.pixels();
    return {pixels.begin(), pixels.end()};
}

/// Opaque balls, many of which touch and some of which coincide, over a floor; above them glass.
Scene heap_of_balls(Rng& rng, const Vec3& place, std::size_t count, bool glass_in_glass = false) {
    SceneBuilder b;
    LocalTexture shiny = mirror();
    shiny.krg = {0.5, 0.4, 0.3}, shiny.kd = {0.3, 0.3, 0.3};
    std::vector<SolidIndex> members{b.solid(Plane{place, {0, 0, 1}}, matte(0.5))};
    Vec3 center{};
    double radius = 0.3;
    for (std::size_t i = 0; i < count; ++i) {
        if (rng.below(8) != 0) // else once more
            center = {rng.between(-4, 4), rng.between(-4, 4), rng.between(0, 3)},
            radius = rng.between(0.05, 0.4);
        members.push_back(b.solid(Sphere{place + center, radius}, shiny));
    }
    std::vector<Priority> priorities;
    if (glass_in_glass) {
        members.push_back(
            b.solid(Sphere{place + Vec3{-3, 0, 4.3}, 0.8}, glass(), IsotropicVolume{1.2}));
        members.push_back(
            b.solid(Sphere{place + Vec3{-3, 0, 4.3}, 0.5}, glass(), IsotropicVolume{1.5}));
        priorities = {{members[count + 2], members[count + 1]}};
    }
    b.aggregate(members, priorities);
    b.scene.world.lights = {PointLight{place + Vec3{-6, -3, 9}, {0.6, 0.5, 0.7}},
                            DirectionalLight{{1, 2, -3}, {0.3, 0.3, 0.2}}};
    b.scene.world.ambient_light = {0.1, 0.1, 0.1};
    b.scene.world.background_light = {0.2, 0.3, 0.5};
    HorizontalCamera camera;
    camera.origin = place + Vec3{-9, 0.3, 3};
    camera.direction = {1, 0, -0.2};
    camera.focal = 1, camera.screen_width = 1, camera.screen_height = 0.75;
    b.scene.camera = camera;
    return b.scene;
}

TEST_CASE("every instruction set and every tile size draws the same bits") {
    for_each_seed(scenes, [](Rng& rng) {
        const auto scene = std::make_shared<const Scene>(
            rng.below(4) == 0 ? heap_of_balls(rng, {}, 60, rng.below(2) == 0) : random_scene(rng));
        const RenderSettings settings{
            .size = {37, 23}, .depth = 8, .aa = static_cast<std::uint32_t>(rng.below(3))};
        std::vector<float> want;
        for (const kernel::KernelEntry* entry : kernel::usable_entries()) {
            const auto compiled = kernel::compile_for(*entry, scene);
            REQUIRE(compiled != nullptr);
            for (const Extent tile : {Extent{37, 23}, Extent{5, 4}, Extent{16, 1}}) {
                CAPTURE(entry->isa);
                CAPTURE(tile.width);
                const auto got = pixels_of(*compiled, settings, tile);
                if (want.empty())
                    want = got;
                CHECK(got == want);
            }
        }
    });
}

/// Every instruction set and every tile gives the reference's picture, but for rounding.
void check_one_picture(const Scene& scene, const RenderSettings& settings) {
    const auto shared = std::make_shared<const Scene>(scene);
    const auto reference = draw(scene, Kernel::reference, settings);
    REQUIRE(reference.has_value());
    std::vector<float> want;
    for (const kernel::KernelEntry* entry : kernel::usable_entries())
        for (const Extent tile : {settings.size, Extent{5, 5}, Extent{1, 1}}) {
            CAPTURE(entry->isa);
            CAPTURE(tile.width);
            const auto got = pixels_of(*kernel::compile_for(*entry, shared), settings, tile);
            if (want.empty())
                want = got;
            CHECK(got == want);
        }
    std::size_t different = 0;
    for (std::size_t i = 0; i < want.size(); ++i)
        different += std::abs(want[i] - reference->film.pixels()[i]) > 0.01F ? 1U : 0U;
    CHECK(different <= want.size() / 50);
}

TEST_CASE("balls in glass are not seen by rays in it, whoever goes beside them") {
    SceneBuilder b;
    std::vector<SolidIndex> members{b.solid(Plane{{0, 0, -1.6}, {0, 0, 1}}, mirror(0.7))};
    for (int i = 0; i < 4; ++i) {
        const Vec3 center{3.0 + i, 2.4 * i - 3.6, 0.1 * i};
        members.push_back(b.solid(Sphere{center, 1.1}, glass(), IsotropicVolume{1.2}));
        for (int k = 0; k < 20; ++k)
            members.push_back(b.solid(
                Sphere{center + 0.2 * Vec3{k % 3 - 1.0, k / 3 % 3 - 1.0, k / 9 - 1.0}, 0.15},
                matte(0.1 * (k % 7))));
    }
    b.aggregate(members);
    b.scene.world.background_light = {0.3, 0.5, 0.8};
    check_one_picture(b.scene, {.size = {80, 60}, .depth = 8});
}

TEST_CASE("two balls entered at one time: the same picture, whoever goes beside the ray") {
    SceneBuilder b;
    const SolidIndex left = b.solid(Sphere{{3, 1, 0.4}, 1.3}, glass(), IsotropicVolume{1.5});
    const SolidIndex right = b.solid(Sphere{{3, -1, 0.4}, 1.3}, glass(), IsotropicVolume{1.3});
    b.aggregate({b.solid(Plane{{0, 0, -1.5}, {0, 0, 1}}, mirror(0.8)),
                 b.solid(Plane{{9, 0, 0}, {-1, 0, 0}}, mirror(0.6)), left, right},
                {{left, right}});
    b.scene.world.background_light = {0.3, 0.5, 0.8};
    check_one_picture(b.scene, {.size = {41, 31}, .depth = 8, .exact = true});
}

TEST_CASE("balls as small as a pixel are seen, however the picture is cut") {
    for_each_seed(scenes, [](Rng& rng) {
        SceneBuilder b;
        std::vector<SolidIndex> members;
        for (int i = 0; i < 20; ++i)
            members.push_back(b.solid(
                Sphere{{10, rng.between(-6, 6), rng.between(-6, 6)}, rng.between(0.05, 0.3)},
                matte(0.5)));
        b.aggregate(members);
        b.scene.world.ambient_light = {1, 1, 1};
        const double side = rng.between(0.5, 3); // of a screen so wide that corners look far aside
        b.scene.camera = HorizontalCamera{{0, 0, 0}, {1, 0, 0}, rng.between(0.5, 2), side, side};
        const auto compiled = compile_scene(std::make_shared<const Scene>(b.scene), Kernel::fast);
        const RenderSettings settings{.size = {32, 32}};
        CHECK(pixels_of(*compiled, settings, {32, 32}) == pixels_of(*compiled, settings, {4, 4}));
    });
}

TEST_CASE("many samples of a pixel, in several blocks, are the same bits in every tile") {
    Rng rng(7);
    const auto scene = std::make_shared<const Scene>(random_scene(rng));
    const RenderSettings settings{.size = {3, 2}, .depth = 5, .aa = 40}; // 1600 a pixel
    const auto compiled = compile_scene(scene, Kernel::fast);
    CHECK(pixels_of(*compiled, settings, {3, 2}) == pixels_of(*compiled, settings, {1, 1}));
}

TEST_CASE("a thread that was stopped in a tile draws its next one as any other does") {
    Rng rng(7);
    const auto scene = std::make_shared<const Scene>(random_scene(rng));
    const auto compiled = compile_scene(scene, Kernel::fast);
    const RenderSettings settings{.size = {16, 16}, .depth = 8, .aa = 40};
    std::vector<float> want;
    std::jthread([&] { want = pixels_of(*compiled, settings, {4, 2}); }).join();
    const RenderSettings endless{.size = {512, 512}, .depth = 8, .aa = 40};
    RenderControl control;
    {
        const std::jthread stopper([&] {
            while (control.rays < 50'000)
                std::this_thread::yield();
            control.stop = true;
        });
        const auto stopped = compiled->render_tile(endless, {0, 0, 512, 512}, control);
        REQUIRE(!stopped.has_value());
        CHECK(stopped.error().code == ErrorCode::cancelled);
    }
    CHECK(pixels_of(*compiled, settings, {4, 2}) == want);
}

TEST_CASE("the hierarchy's float boxes hide no sphere, near the origin or 1e9 away") {
    for (const double offset : {0.0, 1e3, 1e5, 1e7, 1e9})
        for_each_seed(scenes / 20, [&](Rng& rng) {
            CAPTURE(offset);
            const Vec3 place{offset, -offset / 3, offset / 7};
            const auto scene =
                std::make_shared<const Scene>(heap_of_balls(rng, place, 300, rng.below(2) == 0));
            const RenderSettings settings{.size = {64, 48}, .depth = 6};
            for (const kernel::KernelEntry* entry : kernel::usable_entries()) {
                kernel::SolidLimits no_hierarchy;
                no_hierarchy.spheres_apart_min = 1'000'000;
                const auto listed = kernel::compile_for(*entry, scene, no_hierarchy);
                const auto boxed = kernel::compile_for(*entry, scene);
                CHECK(pixels_of(*boxed, settings, {64, 48}) ==
                      pixels_of(*listed, settings, {64, 48}));
            }
        });
}

TEST_CASE("an instruction set has two names; one that is not there is refused") {
    const auto entries = kernel::usable_entries();
    REQUIRE(!entries.empty());
    const std::string isa = entries.front()->isa;
    CHECK(*kernel::choose_entry(isa) == entries.front());
    CHECK(*kernel::choose_entry(isa.substr(isa.rfind('-') + 1)) == entries.front());
    CHECK(*kernel::choose_entry("") == entries.back());
    const auto refused = kernel::choose_entry("x86-64-v9");
    REQUIRE(!refused.has_value());
    CHECK(refused.error().code == ErrorCode::invalid_argument);
    CHECK(refused.error().message.find(isa) != std::string::npos);
}

} // namespace
} // namespace fraja
