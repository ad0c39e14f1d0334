#include "client/page/overview.hpp"

#include "common/image/quantise.hpp"

#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::client;

namespace {

/// Of each pixel red is its column and green its row, in hundredths.
Film ramp(Extent size, const PixelRect& region) {
    Film film(size, region);
    Tile tile{.rect = region, .rgb = {}};
    for (std::uint32_t y = region.y; y < region.y + region.height; ++y)
        for (std::uint32_t x = region.x; x < region.x + region.width; ++x)
            tile.rgb.insert(tile.rgb.end(),
                            {static_cast<float>(x) / 100, static_cast<float>(y) / 100, 0});
    film.place(tile);
    return film;
}

} // namespace

TEST_CASE("an overview fits its limit, and shows small pictures pixel by pixel") {
    CHECK(overview_scale({0, 0, 1, 1}) == 1);
    CHECK(overview_scale({7, 7, overview_side_max, 9}) == 1);
    CHECK(overview_scale({0, 0, 9, overview_side_max + 1}) == 2);
    CHECK(overview_scale({0, 0, 65'536, 4096}) == 32);
    const Film film = ramp({9, 9}, {2, 3, 5, 4});
    CHECK(overview_of(film, 1) == LevelsPicture{{5, 4}, quantise(film.pixels())});
}

TEST_CASE("an overview's pixel is the mean of those it stands for") {
    const LevelsPicture small = overview_of(ramp({9, 9}, {2, 3, 5, 3}), 2);
    CHECK(small.extent == Extent{3, 2});
    CHECK(small.rgb[0] == quantise(0.025f)); // columns 2 and 3
    CHECK(small.rgb[1] == quantise(0.035f)); // rows 3 and 4
    CHECK(small.rgb[6] == quantise(0.06f));  // at the edge there is one column
    CHECK(small.rgb[10] == quantise(0.05f)); // and one row
}

TEST_CASE("a part is cut out pixel by pixel") {
    const Film film = ramp({99, 99}, {10, 20, 30, 40});
    const LevelsPicture part = cut_out(film, {12, 23, 2, 2});
    CHECK(part.extent == Extent{2, 2});
    CHECK(part.rgb == std::vector<std::uint8_t>{quantise(0.12f), quantise(0.23f), 0,
                                                quantise(0.13f), quantise(0.23f), 0,
                                                quantise(0.12f), quantise(0.24f), 0,
                                                quantise(0.13f), quantise(0.24f), 0});
    CHECK(cut_out(film, film.region()) == overview_of(film, 1));
}

TEST_CASE("a picture is encoded once, however often it is asked for") {
    EncodedOnce once(overview_of(ramp({4, 4}, {0, 0, 4, 4}), 1), "jpg");
    const auto first = once.bytes(), again = once.bytes();
    REQUIRE(first);
    REQUIRE(again);
    CHECK((*first)->starts_with("\xff\xd8"));
    CHECK(*first == *again); // the same bytes in memory
    EncodedOnce bad(overview_of(ramp({4, 4}, {0, 0, 4, 4}), 1), "nothing");
    CHECK_FALSE(bad.bytes());
}
