#include "common/base/instant.hpp"

#include <doctest/doctest.h>
#include <limits>

using namespace fraja;
using namespace std::chrono_literals;

TEST_CASE("seconds and durations are one another; what does not fit is the nearest that does") {
    constexpr double inf = std::numeric_limits<double>::infinity();
    CHECK(seconds(1500ms) == 1.5);
    CHECK(from_seconds(1.5) == 1500ms);
    CHECK(from_seconds(-0.25) == -250ms);
    CHECK(from_seconds(0) == 0ns);
    CHECK(from_seconds(1.9e-9) == 1ns);
    CHECK(from_seconds(9'000'000'000) == 9'000'000'000s);
    CHECK(from_seconds(9'223'372'037) == Duration::max());
    CHECK(from_seconds(seconds(Duration::max())) == Duration::max());
    CHECK(from_seconds(-9'223'372'037) == Duration::min());
    CHECK(from_seconds(std::numeric_limits<double>::quiet_NaN()) == Duration::max());
    CHECK(from_seconds(inf) == Duration::max());
    CHECK(from_seconds(-inf) == Duration::min());
}
