#include "common/image/film.hpp"

#include "tests/support/seeds.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <vector>

namespace fraja {
namespace {

/// A tile whose every float says where it is.
Tile numbered_tile(PixelRect rect) {
    Tile tile{rect, {}};
    const auto at = [](std::uint32_t x, std::uint32_t y, std::uint32_t channel) {
        return static_cast<float>(10'000 * y + 10 * x + channel);
    };
    for (std::uint32_t y = rect.y; y < rect.y + rect.height; ++y)
        for (std::uint32_t x = rect.x; x < rect.x + rect.width; ++x) {
            for (std::uint32_t channel = 0; channel < 3; ++channel)
                tile.rgb.push_back(at(x, y, channel));
            tile.samples.push_back(at(x, y, 3));
            tile.error.push_back(at(x, y, 4));
        }
    return tile;
}

TEST_CASE("a film is black until tiles are placed") {
    const Film film(Extent{3, 2});
    CHECK(film.region() == PixelRect{0, 0, 3, 2});
    CHECK(film.size() == Extent{3, 2});
    REQUIRE(film.pixels().size() == 18);
    for (const float component : film.pixels())
        CHECK(component == 0.0f);
}

TEST_CASE("a film puts tiles where they belong") {
    Film film(Extent{4, 3});
    film.place({{1, 2, 2, 1}, {1, 2, 3, 4, 5, 6}});
    CHECK(film.pixels()[3 * (2 * 4 + 1)] == 1.0f);
    CHECK(film.pixels()[3 * (2 * 4 + 2) + 2] == 6.0f);
    CHECK(film.pixels()[3 * (2 * 4 + 3)] == 0.0f);
    film.place({{1, 2, 1, 1}, {7, 8, 9}}); // the last one stays
    CHECK(film.pixels()[3 * (2 * 4 + 1)] == 7.0f);
}

TEST_CASE("a film of a part of a picture counts from the picture's corner") {
    Film film({100, 50}, {60, 40, 3, 2});
    film.place(numbered_tile({61, 41, 2, 1}));
    CHECK(film.pixels()[3 * (1 * 3 + 1)] == 410'610.0f);
    CHECK(film.pixels()[3 * (1 * 3 + 2) + 2] == 410'622.0f);
    CHECK(film.pixels()[0] == 0.0f);
}

TEST_CASE("an empty region holds nothing") {
    CHECK(Film({8, 8}, {8, 8, 0, 0}).pixels().empty());
}

TEST_CASE("a film keeps samples and errors where it is told to, and only there") {
    const PixelRect region{60, 40, 3, 2};
    const Film colours({100, 50}, region);
    CHECK(colours.samples().empty());
    CHECK(colours.error().empty());
    Film both({100, 50}, region, {.estimates = true});
    CHECK(std::ranges::count(both.samples(), 0.0F) == 6);
    CHECK(std::ranges::count(both.error(), 0.0F) == 6);
    both.place(numbered_tile({61, 41, 2, 1}));
    CHECK(both.pixels()[3 * (1 * 3 + 1)] == 410'610.0f);
    CHECK(
        std::ranges::equal(both.samples(), std::vector{0.f, 0.f, 0.f, 0.f, 410'613.f, 410'623.f}));
    CHECK(std::ranges::equal(both.error(), std::vector{0.f, 0.f, 0.f, 0.f, 410'614.f, 410'624.f}));
    CHECK(Film({8, 8}, {8, 8, 0, 0}, {.estimates = true}).error().empty());
}

TEST_CASE("a film of colours takes a tile with samples and errors, and drops them") {
    Film film({4, 3}, {0, 0, 4, 3});
    film.place(numbered_tile({1, 1, 2, 2}));
    CHECK(film.pixels()[3 * (2 * 4 + 2)] == 20'020.0f);
    CHECK(film.samples().empty());
    CHECK(film.error().empty());
}

TEST_CASE("a film keeps layers plane by plane where it is told to, and only there") {
    Film film({10, 10}, {4, 4, 2, 2}, {.layers = true});
    Tile tile{.rect = {5, 4, 1, 2}, .rgb = std::vector<float>(6)};
    for (std::size_t i = 0; i < 2 * layer_names.size(); ++i)
        tile.layers.push_back(static_cast<float>(i + 1));
    film.place(tile);
    CHECK(std::ranges::equal(film.layers(), std::vector<float>{0, 1, 0, 2, 0, 3, 0, 4, 0, 5,
                                                               0, 6, 0, 7, 0, 8, 0, 9, 0, 10}));
    CHECK(film.samples().empty());
    Film colours({10, 10}, {4, 4, 2, 2});
    colours.place(tile);
    CHECK(colours.layers().empty());
}

TEST_CASE("however a region is cut into tiles, the film is the same") {
    for_each_seed(100, [](Rng& rng) {
        const PixelRect region{static_cast<std::uint32_t>(rng.below(5)),
                               static_cast<std::uint32_t>(rng.below(5)),
                               static_cast<std::uint32_t>(1 + rng.below(9)),
                               static_cast<std::uint32_t>(1 + rng.below(9))};
        const auto width = static_cast<std::uint32_t>(1 + rng.below(4));
        const auto height = static_cast<std::uint32_t>(1 + rng.below(4));
        Film film({20, 20}, region, {.estimates = true});
        for (std::uint32_t y = 0; y < region.height; y += height)
            for (std::uint32_t x = 0; x < region.width; x += width)
                film.place(
                    numbered_tile({region.x + x, region.y + y, std::min(width, region.width - x),
                                   std::min(height, region.height - y)}));
        const Tile whole = numbered_tile(region);
        CHECK(std::ranges::equal(film.pixels(), whole.rgb));
        CHECK(std::ranges::equal(film.samples(), whole.samples));
        CHECK(std::ranges::equal(film.error(), whole.error));
    });
}

} // namespace
} // namespace fraja
