// Where samples are taken: Raja's grid to the bit, and what a filter makes of spread points.
#include "common/render/sampling/places.hpp"

#include "tests/support/seeds.hpp"

#include <algorithm>
#include <cmath>
#include <doctest/doctest.h>
#include <tuple>
#include <vector>

namespace fraja {
namespace {

struct Places {
    std::vector<double> x, y;
    friend bool operator==(const Places&, const Places&) = default;
};

Places places(const SamplePlaces& from, std::uint32_t column, std::uint32_t row,
              std::uint32_t count, std::uint64_t first = 0) {
    Places p{std::vector<double>(count), std::vector<double>(count)};
    from.fill(column, row, first, count, p.x.data(), p.y.data());
    return p;
}

PixelRect whole(Extent size) {
    return {0, 0, size.width, size.height};
}

constexpr RenderSettings tent{.size = {37, 23}, .spp = 64, .filter = Filter::tent};
constexpr RenderSettings box{.size = {37, 23}, .spp = 64};

TEST_CASE("samples of another seed have nothing to do with these, however far on") {
    RenderSettings other = box;
    other.seed = 1;
    const SamplePlaces one(box, whole(box.size), false), two(other, whole(box.size), false);
    const Places a = places(one, 5, 7, 64), b = places(two, 5, 7, 64);
    // Of one sequence, samples 2^24 on have the same x; of independent ones no two are as near.
    const Places far = places(one, 5, 7, 64, std::uint64_t{1} << 24);
    for (std::size_t i = 0; i < 64; ++i) {
        CHECK(std::abs(a.x[i] - far.x[i]) < 1e-7);
        CHECK(std::abs(a.x[i] - b.x[i]) > 1e-7);
        CHECK(std::abs(a.y[i] - b.y[i]) > 1e-7);
    }
}

TEST_CASE("a grid's places are Raja's to the bit, and so is the one at the centre") {
    for (const std::uint32_t n : {0u, 1u, 2u, 3u, 7u}) {
        const RenderSettings settings{.size = {37, 23}, .aa = n};
        const SamplePlaces all(settings, whole(settings.size), false);
        const std::uint32_t count = std::max(n * n, 1u);
        for (std::uint32_t i = 0; i < 37; ++i)
            for (std::uint32_t j = 0; j < 23; ++j) {
                Places want; // FORMAT.md, section 5, word by word
                if (n == 0) {
                    want = {{(i + 0.5) / 37}, {(j + 0.5) / 23}};
                } else {
                    const double dx = 1.0 / (n * 37), dy = 1.0 / (n * 23);
                    const double px = 0.5 * dx + i / 37.0, py = 0.5 * dy + j / 23.0;
                    for (std::uint32_t kx = 0; kx < n; ++kx)
                        for (std::uint32_t ky = 0; ky < n; ++ky)
                            want.x.push_back(px + kx * dx), want.y.push_back(py + ky * dy);
                }
                CHECK(places(all, i, j, count) == want);
            }
    }
}

TEST_CASE("a pixel's samples are the same whatever the rectangle, and however many are asked for") {
    for_each_seed(20, [](Rng& rng) {
        for (const RenderSettings& settings :
             {box, tent, RenderSettings{.size = {37, 23}, .aa = 8}}) {
            const auto column = static_cast<std::uint32_t>(rng.below(37));
            const auto row = static_cast<std::uint32_t>(rng.below(23));
            const auto left = static_cast<std::uint32_t>(rng.below(column + 1));
            const auto top = static_cast<std::uint32_t>(rng.below(row + 1));
            const PixelRect rect{left, top, column - left + 1, row - top + 1};
            const SamplePlaces all(settings, whole(settings.size), false);
            const SamplePlaces part(settings, rect, false);
            const Places want = places(all, column, row, 64);
            CHECK(places(part, column, row, 64) == want);
            const auto cut = static_cast<std::uint32_t>(1 + rng.below(63));
            Places got = places(part, column, row, cut);
            const Places rest = places(part, column, row, 64 - cut, cut);
            got.x.insert(got.x.end(), rest.x.begin(), rest.x.end());
            got.y.insert(got.y.end(), rest.y.begin(), rest.y.end());
            CHECK(got == want);
        }
    });
}

TEST_CASE("every pixel has its own places, and adaptive ones have those of all") {
    const SamplePlaces all(box, whole(box.size), false);
    const auto within = [&](std::uint32_t column, std::uint32_t row) {
        const Places p = places(all, column, row, 1);
        return std::pair(p.x[0] * 37 - column, p.y[0] * 23 - row);
    };
    std::vector<std::pair<double, double>> offsets;
    for (std::uint32_t i = 0; i < 37; ++i)
        for (std::uint32_t j = 0; j < 23; ++j)
            offsets.push_back(within(i, j));
    std::ranges::sort(offsets);
    const auto near = [](const auto& a, const auto& b) {
        return std::abs(a.first - b.first) < 1e-9 && std::abs(a.second - b.second) < 1e-9;
    };
    CHECK(std::ranges::adjacent_find(offsets, near) == offsets.end());
    const RenderSettings adaptive{.size = {37, 23}, .error = 1};
    CHECK(places(SamplePlaces(adaptive, {}, false), 5, 6, 64) == places(all, 5, 6, 64));
}

/// From the pixel's middle, in pixels.
std::vector<std::pair<double, double>> offsets(const RenderSettings& settings, std::uint32_t column,
                                               std::uint32_t row, std::uint32_t count) {
    const Places p = places(SamplePlaces(settings, {}, false), column, row, count);
    std::vector<std::pair<double, double>> all;
    for (std::uint32_t i = 0; i < count; ++i)
        all.emplace_back(p.x[i] * settings.size.width - column - 0.5,
                         p.y[i] * settings.size.height - row - 0.5);
    return all;
}

struct Moments {
    double dx = 0, dy = 0, dx_2 = 0, dy_2 = 0, dx_4 = 0, dy_4 = 0, dx_dy = 0, farthest = 0;
};

Moments moments(const std::vector<std::pair<double, double>>& offsets) {
    Moments m;
    const auto n = static_cast<double>(offsets.size());
    for (const auto& [dx, dy] : offsets) {
        m.dx += dx / n, m.dx_2 += dx * dx / n, m.dx_4 += dx * dx * dx * dx / n;
        m.dy += dy / n, m.dy_2 += dy * dy / n, m.dy_4 += dy * dy * dy * dy / n;
        m.dx_dy += dx * dy / n;
        m.farthest = std::max({m.farthest, std::abs(dx), std::abs(dy)});
    }
    return m;
}

/// Of numbers that have these second and fourth moments and a mean of 0.
void check_moments(const Moments& m, double second, double fourth) {
    CHECK(std::abs(m.dx) < 1e-3);
    CHECK(std::abs(m.dy) < 1e-3);
    CHECK(std::abs(m.dx_2 - second) < 1e-3);
    CHECK(std::abs(m.dy_2 - second) < 1e-3);
    CHECK(std::abs(m.dx_4 - fourth) < 1e-3);
    CHECK(std::abs(m.dy_4 - fourth) < 1e-3);
    CHECK(std::abs(m.dx_dy) < 1e-3);
}

TEST_CASE("box samples lie in their pixel, everywhere alike") {
    for (const auto& [column, row] : {std::pair{0u, 0u}, {36u, 22u}, {17u, 5u}}) {
        const Moments m = moments(offsets(box, column, row, 4096));
        CHECK(m.farthest < 0.5);
        CHECK(m.farthest > 0.499);
        check_moments(m, 1 / 12.0, 1 / 80.0);
    }
}

TEST_CASE("tent samples reach half a pixel around theirs, ever fewer") {
    for (const auto& [column, row] : {std::pair{0u, 0u}, {36u, 22u}, {17u, 5u}}) {
        const Moments m = moments(offsets(tent, column, row, 4096));
        CHECK(m.farthest < 1);
        CHECK(m.farthest > 0.95);
        check_moments(m, 1 / 6.0, 1 / 15.0);
    }
}

TEST_CASE("a stereo camera's tent samples stay in their half") {
    for (const std::uint32_t width : {1u, 2u, 36u, 37u}) {
        RenderSettings settings = tent;
        settings.size.width = width;
        std::size_t wrong = 0, over = 0;
        for (std::uint32_t column = 0; column < width; ++column) {
            const bool right = 2 * column + 1 >= width;
            const auto beyond = [&](bool two_pictures) {
                const Places p = places(SamplePlaces(settings, {}, two_pictures), column, 3, 64);
                return static_cast<std::size_t>(
                    std::ranges::count_if(p.x, [&](double x) { return (x >= 0.5) != right; }));
            };
            wrong += beyond(true), over += beyond(false);
        }
        CAPTURE(width);
        CHECK(wrong == 0);
        CHECK(over > 0); // those of one picture do not
    }
}

TEST_CASE("box samples, and rows, know nothing of a stereo camera") {
    for (const std::uint32_t column : {17u, 18u, 19u}) {
        CHECK(places(SamplePlaces(box, {}, true), column, 3, 64) ==
              places(SamplePlaces(box, {}, false), column, 3, 64));
        CHECK(places(SamplePlaces(tent, {}, true), column, 11, 64).y ==
              places(SamplePlaces(tent, {}, false), column, 11, 64).y);
    }
}

} // namespace
} // namespace fraja
