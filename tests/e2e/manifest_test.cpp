#include "tests/e2e/manifest.hpp"

using namespace fraja::e2e;

TEST_CASE("every row of the manifest below 640x480 is Raja's picture when drawn locally") {
    check_locally(rows(false));
}

TEST_CASE("every row of the manifest below 640x480 is Raja's picture when drawn by two workers") {
    check_on_a_farm(rows(false));
}
