#include "broker/tile_plan.hpp"

#include "tests/support/seeds.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <numeric>
#include <vector>

using namespace fraja;
using namespace fraja::broker;
using protocol::TileOrder;

TEST_CASE("every cell is handed out exactly once whatever the order") {
    for_each_seed(200, [](Rng& rng) {
        const auto columns = 1 + static_cast<std::uint32_t>(rng.below(70));
        const auto rows = 1 + static_cast<std::uint32_t>(rng.below(70));
        for (const TileOrder order :
             {TileOrder::automatic, TileOrder::scan, TileOrder::spiral, TileOrder::diadic}) {
            auto cells = ordered_cells(columns, rows, order);
            std::ranges::sort(cells);
            std::vector<std::uint32_t> all(std::size_t{columns} * rows);
            std::iota(all.begin(), all.end(), 0u);
            CHECK(cells == all);
        }
    });
}

TEST_CASE("the diadic order starts with the corners and goes on halfway between") {
    const auto cells = ordered_cells(5, 3, TileOrder::diadic);
    REQUIRE(cells.size() == 15);
    const auto at = [&](std::size_t i) { return std::pair(cells[i] % 5, cells[i] / 5); };
    CHECK(at(0) == std::pair(0u, 0u));
    CHECK(at(1) == std::pair(0u, 2u));
    CHECK(at(2) == std::pair(4u, 0u));
    CHECK(at(3) == std::pair(4u, 2u));
    CHECK(at(4) == std::pair(2u, 1u)); // new column, new row
    CHECK(at(5) == std::pair(0u, 1u)); // old columns, new row
    CHECK(at(6) == std::pair(4u, 1u));
    CHECK(at(7) == std::pair(2u, 0u)); // new column, old rows
}

TEST_CASE("the spiral starts in the middle and ends at the border") {
    const auto cells = ordered_cells(5, 5, TileOrder::spiral);
    CHECK(cells.front() == 12);
    const std::uint32_t x = cells.back() % 5, y = cells.back() / 5;
    CHECK((x == 0 || y == 0 || x == 4 || y == 4));
}

TEST_CASE("automatic cells are as small as their number may be") {
    protocol::PictureSettings settings;
    const auto side = [&](std::uint32_t width, std::uint32_t height) {
        settings.crop = {0, 0, width, height};
        return automatic_cell_side(settings);
    };
    CHECK(side(1, 1) == 2);
    CHECK(side(640, 480) == 2);
    CHECK(side(1600, 1200) == 4);
    CHECK(side(4096, 3072) == 8);
    CHECK(side(65'536, 4'096) == 32);
    settings.error = 1; // small tiles would draw as much around them as in them
    CHECK(side(1, 1) == 8);
    CHECK(side(65'536, 4'096) == 32);
    settings.error = 0;
    settings.time_limit = std::chrono::seconds(1); // tiles are cells then
    CHECK(side(1, 1) == 32);
    CHECK(side(900, 800) == 32);
    CHECK(side(60'000, 4'000) == 64);
}
