#include "broker/tile_plan.hpp"

#include "tests/support/seeds.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <vector>

using namespace fraja;
using namespace fraja::broker;
using protocol::TileOrder;

TEST_CASE("every pixel of the crop lies in exactly one tile whatever the order") {
    for_each_seed(200, [](Rng& rng) {
        const PixelRect crop{static_cast<std::uint32_t>(rng.below(50)),
                             static_cast<std::uint32_t>(rng.below(50)),
                             1 + static_cast<std::uint32_t>(rng.below(70)),
                             1 + static_cast<std::uint32_t>(rng.below(70))};
        const auto side = 1 + static_cast<std::uint32_t>(rng.below(80));
        for (const TileOrder order :
             {TileOrder::automatic, TileOrder::scan, TileOrder::spiral, TileOrder::diadic}) {
            const auto tiles = plan_tiles(crop, side, order);
            CHECK(tiles.size() == tile_count(crop, side));
            std::vector<int> covered(crop.pixel_count());
            for (const PixelRect& t : tiles) {
                CHECK(t.width <= side);
                CHECK(t.height <= side);
                REQUIRE(t.x >= crop.x);
                REQUIRE(t.y >= crop.y);
                REQUIRE(t.x + t.width <= crop.x + crop.width);
                REQUIRE(t.y + t.height <= crop.y + crop.height);
                for (std::uint32_t y = t.y; y < t.y + t.height; ++y)
                    for (std::uint32_t x = t.x; x < t.x + t.width; ++x)
                        ++covered[(y - crop.y) * crop.width + (x - crop.x)];
            }
            CHECK(std::ranges::all_of(covered, [](int n) { return n == 1; }));
        }
    });
}

TEST_CASE("a crop's tiles lie on the picture's grid") {
    const auto tiles = plan_tiles({20, 70, 50, 10}, 32, TileOrder::scan);
    CHECK(tiles == std::vector<PixelRect>{{20, 70, 12, 10}, {32, 70, 32, 10}, {64, 70, 6, 10}});
    // Where coordinates end.
    constexpr std::uint32_t end = 0xffffffff;
    CHECK(plan_tiles({end - 3, 0, 3, 1}, 64, TileOrder::scan) ==
          std::vector<PixelRect>{{end - 3, 0, 3, 1}});
    CHECK(tile_count({end - 3, 0, 3, 1}, 2) == 2);
}

TEST_CASE("the diadic order starts with the corners and goes on halfway between") {
    const auto tiles = plan_tiles({0, 0, 5, 3}, 1, TileOrder::diadic);
    REQUIRE(tiles.size() == 15);
    const auto at = [&](std::size_t i) { return std::pair(tiles[i].x, tiles[i].y); };
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
    const auto tiles = plan_tiles({0, 0, 50, 50}, 10, TileOrder::spiral);
    CHECK(tiles.front() == PixelRect{20, 20, 10, 10});
    const PixelRect last = tiles.back();
    CHECK((last.x == 0 || last.y == 0 || last.x == 40 || last.y == 40));
}

TEST_CASE("the automatic side stays within its bounds") {
    protocol::PictureSettings settings;
    const auto side = [&](std::uint32_t width, std::uint32_t height) {
        settings.crop = {0, 0, width, height};
        return automatic_tile_side(settings);
    };
    CHECK(side(640, 480) == 32);
    CHECK(side(1, 1) == 8);
    CHECK(side(60'000, 4'000) == 64);
    const auto is_32_or_64 = [&] {
        CHECK(side(1, 1) == 32);
        CHECK(side(900, 800) == 32);
        CHECK(side(60'000, 4'000) == 64);
    };
    CHECK(side(900, 800) == 48);
    settings.error = 1; // small tiles would draw as much around them as in them
    is_32_or_64();
    settings.error = 0;
    settings.time_limit = std::chrono::seconds(1); // and 4 samples a pixel would be too little work
    is_32_or_64();
}
