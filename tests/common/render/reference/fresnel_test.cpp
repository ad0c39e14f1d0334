#include "common/render/reference/fresnel.hpp"

#include <cmath>
#include <doctest/doctest.h>
#include <initializer_list>

namespace fraja::reference {
namespace {

constexpr Vec3 towards{-1, 0, 0}; // the normal of a surface that a ray along x enters

TEST_CASE("at a right angle, where the formula is 0 / 0, its limit counts") {
    struct Row {
        double index_in, index_out, reflectance;
    };
    for (const Row& row : {Row{1.5, 1, 0.04}, Row{1, 1.5, 0.04}, Row{1, 1, 0}, Row{3, 1, 0.25}}) {
        CAPTURE(row.index_in);
        for (const Vec3& dir :
             {Vec3{1, 0, 0}, Vec3{-1, 0, 0}, Vec3{std::nextafter(1.0, 2.0), 0, 0}}) {
            const auto refraction = refract({dir, towards, row.index_in, row.index_out});
            REQUIRE(refraction.has_value());
            CHECK(refraction->reflectance == doctest::Approx(row.reflectance));
            CHECK(refraction->dir == dir);
        }
    }
}

TEST_CASE("the limit continues the formula") {
    const double small = 1e-4;
    const auto near = refract({normalized({1, small, 0}), towards, 1.5, 1});
    const auto at = refract({{1, 0, 0}, towards, 1.5, 1});
    REQUIRE((near && at));
    CHECK(near->reflectance == doctest::Approx(at->reflectance).epsilon(1e-6));
    CHECK(length(near->dir - at->dir) < 2 * small);
}

TEST_CASE("light bends as Snell says") {
    const double angle = 0.7;
    const auto entering = refract({{std::cos(angle), std::sin(angle), 0}, towards, 1.5, 1});
    REQUIRE(entering.has_value());
    CHECK(length(entering->dir) == doctest::Approx(1));
    CHECK(entering->dir.y == doctest::Approx(std::sin(angle) / 1.5));
    const auto leaving = refract({entering->dir, {1, 0, 0}, 1.5, 1});
    REQUIRE(leaving.has_value());
    CHECK(leaving->dir.y == doctest::Approx(std::sin(angle)));
    CHECK(leaving->reflectance == doctest::Approx(entering->reflectance));
}

TEST_CASE("beyond the critical angle all light is reflected") {
    const double critical = std::asin(1 / 1.5);
    CHECK(refract({{std::cos(critical - 1e-9), std::sin(critical - 1e-9), 0}, {1, 0, 0}, 1.5, 1}));
    CHECK(!refract({{std::cos(critical + 1e-9), std::sin(critical + 1e-9), 0}, {1, 0, 0}, 1.5, 1}));
}

TEST_CASE("a grazing ray is reflected and no index breaks the formula") {
    const auto grazing = refract({{0, 1, 0}, towards, 1.5, 1});
    REQUIRE(grazing.has_value());
    CHECK(grazing->reflectance == 1);
    for (const double in : {0.0, 1.0, -1.0, -1.5, 1e-300, 1e300, -0.0})
        for (const double out : {0.0, 1.0, -1.0, 1.5, 1e-300, 1e300})
            for (const double angle : {0.0, 0.3, 1.5, 2.0, 3.0})
                if (const auto r =
                        refract({{std::cos(angle), std::sin(angle), 0}, towards, in, out})) {
                    CHECK(r->reflectance >= 0);
                    CHECK(r->reflectance <= 1);
                    CHECK(is_finite(r->dir));
                }
    CHECK(!refract({{1, 0, 0}, towards, 0, 0}));
}

} // namespace
} // namespace fraja::reference
