// The number of rays, told by Raja's rules, of FORMAT.md section 15: a picture can be right by
// chance, but hardly with the same number of rays.
#include "common/scene/raj_reader.hpp"
#include "tests/support/draw.hpp"

#include <doctest/doctest.h>
#include <filesystem>
#include <string>

namespace fraja {
namespace {

struct Row {
    std::string scene;
    std::uint64_t rays;
    std::uint32_t depth = 5;
    bool exact = false;
};

const Row rows[] = {
    {"cone", 76'800},
    {"overlapping_spheres", 650'012},
    {"overlapping_spheres", 2'022'674, 500},
    {"overlapping_spheres", 993'694, 6, true},
    {"primitives", 161'811},
    {"csg_basic", 218'476},
    {"csg_drilled_cube", 142'036},
    {"lights_directional", 76'800},
    {"lights_many", 140'005},
    {"stereo", 98'065},
    {"checks", 165'434},
    {"labels", 206'547},
    {"camera_in_glass", 363'530},
    {"camera_in_glass", 374'318, 500},
    {"no_blue", 152'569},
    {"tumbler", 472'630},
    {"tumbler", 1'544'397, 20},
    {"texture_forms", 206'057},
    {"halo_aa", 148'284},
    {"single_solid", 181'943},
    {"nested_aggregate", 437'801},
    {"nested_aggregate", 691'823, 500},
    {"camera_screen", 84'447},
    {"mirrors", 256'275},
    {"mirrors", 2'495'259, 500},
    {"index_matched", 171'053},
    {"index_matched", 294'442, 7, true},
    {"glass_shadow", 123'100},
    {"glass_shadow", 152'099, 5, true},
    {"normal_incidence", 227'632},
};

#ifdef FRAJA_INSTRUMENTED // a build in which a ray is ten times as dear
constexpr bool instrumented = true;
#else
constexpr bool instrumented = false;
#endif
constexpr std::uint64_t few_rays = 150'000;

void check(const Row& row) {
    CAPTURE(row.scene);
    CAPTURE(row.depth);
    const auto path = std::filesystem::path(FRAJA_SOURCE_DIR) / "scenes" / (row.scene + ".raj");
    auto scene = read_raj_file(path);
    REQUIRE(scene.has_value());
    const auto compiled =
        compile_scene(std::make_shared<const Scene>(std::move(*scene)), Kernel::reference);
    const auto drawn =
        draw(*compiled, {.size = {320, 240}, .depth = row.depth, .aa = 1, .exact = row.exact});
    REQUIRE(drawn.has_value());
    CHECK(drawn->rays.traced() == row.rays);
    CHECK(drawn->rays.camera == 76'800);
}

TEST_CASE("as many rays are followed as Raja follows") {
    for (const Row& row : rows)
        if (row.rays <= few_rays)
            check(row);
}

TEST_CASE("as many rays are followed as Raja follows, also where they are many" *
          doctest::skip(instrumented)) {
    for (const Row& row : rows)
        if (row.rays > few_rays)
            check(row);
}

} // namespace
} // namespace fraja
