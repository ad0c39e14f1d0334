// Quick here; long by hand, as tools/bench/accuracy.
#include "tests/stress/picture_cases.hpp"
#include "tests/support/draw.hpp"
#include "tests/support/scene_builder.hpp"

#include <algorithm>
#include <doctest/doctest.h>

namespace fraja {
namespace {

#ifdef FRAJA_INSTRUMENTED // a build in which a ray is ten times as dear
constexpr Extent small{24, 18}, large{48, 36};
#else
constexpr Extent small{64, 48}, large{160, 120};
#endif

TEST_CASE("pictures of scenes that are moved, scaled, clear or absurd are as they should be") {
    const auto figures = stress::picture_figures(small, large, 200);
    CHECK(figures.size() == 29);
    for (const stress::Figure& figure : figures) {
        CAPTURE(figure.name);
        CHECK(figure.value <= figure.mark);
    }
}

TEST_CASE("what a picture lacks is told when it is asked for, and the picture is the same") {
    SceneBuilder b;
    b.aggregate({b.solid(Sphere{{0, 0, 0}, 1.5}, glass(), IsotropicVolume{1.5})});
    b.scene.world.ambient_light = {};
    b.scene.world.background_light = {1, 1, 1};
    const auto plain = draw(b.scene, Kernel::fast, {.size = small});
    const auto told = draw(b.scene, Kernel::fast, {.size = small, .truncation = true});
    REQUIRE(plain.has_value());
    REQUIRE(told.has_value());
    CHECK(std::ranges::equal(plain->film.pixels(), told->film.pixels()));
    CHECK(plain->truncated.empty());
    CHECK(*std::ranges::max_element(told->truncated) > 0);
    CHECK(*std::ranges::max_element(told->truncated) < 0.5F);
}

} // namespace
} // namespace fraja
