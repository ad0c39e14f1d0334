#include "common/base/once.hpp"

#include <doctest/doctest.h>

using namespace fraja;
using namespace std::chrono_literals;

TEST_CASE("a thing is said once in a while, and only so many of them") {
    Once once(10s, 2);
    const auto at = [](Duration d) { return Instant{} + d; };
    CHECK(once.is_new(at(0s), "a"));
    CHECK(!once.is_new(at(9s), "a"));
    CHECK(once.is_new(at(9s), "b"));
    CHECK(!once.is_new(at(9s), "c")); // there is no room
    CHECK(once.is_new(at(10s), "a"));
    CHECK(!once.is_new(at(18s), "c"));
    CHECK(once.is_new(at(19s), "c")); // b is forgotten
    CHECK(once.size() == 2);
}
