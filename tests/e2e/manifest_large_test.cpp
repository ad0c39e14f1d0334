#include "tests/e2e/manifest.hpp"

using namespace fraja::e2e;

TEST_CASE("every row of the manifest at 640x480 is Raja's picture when drawn by two workers") {
    check_on_a_farm(rows(true));
}

TEST_CASE("rows of the manifest at 640x480 that are not dear are Raja's when drawn locally") {
    std::vector<ManifestRow> some = rows(true); // the others take a minute, and are drawn above
    std::erase_if(some, [](const ManifestRow& row) { return row.dear; });
    REQUIRE(some.size() >= 2);
    check_locally(some);
}
