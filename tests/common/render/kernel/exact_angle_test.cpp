#include "common/render/kernel/exact_angle.hpp"

#include "tests/support/seeds.hpp"

#include <cmath>
#include <doctest/doctest.h>
#include <limits>

namespace fraja::kernel {
namespace {

TEST_CASE("the tangent and the cosine's square are right to the last bits, in every quarter") {
    for_each_seed(2'000, [](Rng& rng) {
        const double angle = rng.between(-20, 20);
        CAPTURE(angle);
        const ExactAngle a = exact_angle(angle);
        const long double c = std::cos(static_cast<long double>(angle));
        const long double t = std::abs(std::tan(static_cast<long double>(angle)));
        const auto squared = static_cast<long double>(a.cosine_squared.high) + a.cosine_squared.low;
        CHECK(std::abs(squared - c * c) <= 1e-18L);
        CHECK(std::abs(a.tangent - t) <=
              1.2e-16L * t * (1 + std::abs(static_cast<long double>(angle)) * 1e-3L / (c * c)));
    });
}

TEST_CASE("angles that are none, or too great, are 0") {
    constexpr double odd[] = {std::numeric_limits<double>::quiet_NaN(),
                              std::numeric_limits<double>::infinity(), 1e300};
    for (const double angle : odd) {
        CHECK(exact_angle(angle).tangent == 0);
        CHECK(exact_angle(angle).cosine_squared.high == 1);
    }
}

TEST_CASE("a scaled squared length carries twice the digits") {
    const DoubleDouble d = scaled_length_squared({3, 4, 12}, {0.25, 0});
    CHECK(d.high == 169 * 0.25);
    CHECK(d.low == 0);
    const DoubleDouble third = scaled_length_squared({1.0 / 3, 0, 0}, {1, 0});
    const auto want = static_cast<long double>(1.0 / 3) * static_cast<long double>(1.0 / 3);
    CHECK(std::abs(static_cast<long double>(third.high) + third.low - want) <= 1e-19L);
}

} // namespace
} // namespace fraja::kernel
