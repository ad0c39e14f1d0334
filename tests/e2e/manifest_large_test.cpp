#include "tests/e2e/manifest.hpp"

using namespace fraja::e2e;

// They take minutes: each is drawn once.

TEST_CASE("rows of the manifest at 640x480, the odd ones, are Raja's pictures when drawn locally") {
    check_locally(rows(true, 0, 2));
}

TEST_CASE("rows of the manifest at 640x480, the even ones, are Raja's when drawn by two workers") {
    check_on_a_farm(rows(true, 1, 2));
}
