#include "tests/e2e/manifest.hpp"

using namespace fraja::e2e;

// Locally the small ones are drawn (manifest_test.cpp), and all of them without programs
// (tests/golden).
TEST_CASE("every row of the manifest at 640x480 is Raja's picture when drawn by two workers") {
    check_rows_on_a_farm(true);
}
