#include "tests/e2e/manifest.hpp"

using namespace fraja::e2e;

TEST_CASE("every row of the manifest at 640x480 is Raja's picture when drawn locally") {
    check_rows_locally(true);
}

TEST_CASE("every row of the manifest at 640x480 is Raja's picture when drawn by two workers") {
    check_rows_on_a_farm(true);
}
