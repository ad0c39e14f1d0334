#include "common/image/pass_film.hpp"

#include "tests/support/seeds.hpp"

#include <algorithm>
#include <cmath>
#include <doctest/doctest.h>

namespace fraja {
namespace {

constexpr Extent size{4, 2};
const std::vector<std::uint32_t> samples{4, 4, 8};

/// One of the two halves of a pass, all of whose samples have that colour.
Tile half(std::uint32_t index, float value) {
    return {.rect = {2 * index, 0, 2, 2},
            .rgb = std::vector<float>(12, value),
            .variance = std::vector<float>(4, 0),
            .cut = std::vector<float>(4, 0)};
}

PassFilm film() {
    return {size, {0, 0, size.width, size.height}, samples, 2};
}

TEST_CASE("of the first pass each tile is seen at once, of the others whole passes") {
    PassFilm f = film();
    f.place(0, half(1, 0.5f));
    CHECK(f.film().pixels()[3 * 2] == 0.5f);
    CHECK(f.film().pixels()[0] == 0);
    f.place(0, half(0, 0.25f));
    CHECK(f.passes_done() == 1);
    f.place(1, half(0, 0.75f));
    CHECK(f.film().pixels()[0] == 0.25f);
    CHECK(f.film().samples()[0] == 4);
    f.place(1, half(1, 0.5f));
    CHECK(f.passes_done() == 2);
    CHECK(f.film().pixels()[0] == 0.5f); // (4 * 0.25 + 4 * 0.75) / 8
    CHECK(f.film().samples()[0] == 8);
    CHECK(f.film().samples()[2] == 8);
}

TEST_CASE("passes count by their samples, and what is beyond the last whole one does not") {
    PassFilm f = film();
    for (std::uint32_t pass = 0; pass < 3; ++pass)
        for (std::uint32_t i = 0; i < 2; ++i)
            if (pass < 2 || i == 0)
                f.place(pass, half(i, pass == 2 ? 1.0f : 0.0f));
    CHECK(f.passes_done() == 2);
    CHECK(f.film().pixels()[0] == 0);
    f.place(2, half(1, 1.0f));
    CHECK(f.film().pixels()[0] == 0.5f); // 8 of 16
}

TEST_CASE("the same passes give the same bits, in whatever order their tiles come") {
    struct Part {
        std::uint32_t pass;
        Tile tile;
    };
    Rng numbers(7);
    std::vector<Part> parts;
    for (std::uint32_t pass = 0; pass < 3; ++pass)
        for (std::uint32_t i = 0; i < 2; ++i) {
            Tile tile = half(i, 0);
            for (float& value : tile.rgb)
                value = static_cast<float>(numbers.between(0, 1));
            for (float& value : tile.variance)
                value = static_cast<float>(numbers.between(0, 0.2));
            for (float& value : tile.cut)
                value = static_cast<float>(numbers.between(0, 0.1));
            parts.push_back({pass, tile});
        }
    const auto drawn = [&] {
        PassFilm f = film();
        for (const Part& part : parts)
            f.place(part.pass, part.tile);
        CHECK(f.passes_done() == 3);
        std::vector<float> all(f.film().pixels().begin(), f.film().pixels().end());
        all.insert(all.end(), f.film().error().begin(), f.film().error().end());
        return all;
    };
    const std::vector<float> in_order = drawn();
    for_each_seed(20, [&](Rng& rng) {
        for (std::size_t i = parts.size(); i > 1; --i)
            std::swap(parts[i - 1], parts[rng.below(i)]);
        CHECK(drawn() == in_order);
    });
}

TEST_CASE("pixels whose samples agree have no error, others less with every pass") {
    PassFilm f = film();
    float last = 1;
    for (std::uint32_t pass = 0; pass < 3; ++pass) {
        Tile noisy = half(1, 0.5f); // half of its samples 0, half 1, more or less
        for (float& value : noisy.rgb)
            value += pass % 2 == 0 ? 0.01f : -0.01f;
        std::ranges::fill(noisy.variance, 0.25f);
        f.place(pass, noisy);
        f.place(pass, half(0, 0.5f));
        CHECK(f.film().error()[0] == 0);
        CHECK(f.film().error()[2] > 0);
        CHECK(f.film().error()[2] < last);
        last = f.film().error()[2];
    }
}

TEST_CASE("the samples' variance is that of all passes together, also far from 0") {
    // Means of 1000 apart from 0, where sums of squares of floats would say nothing.
    const auto error_of = [](float offset) {
        PassFilm f = film();
        for (std::uint32_t pass = 0; pass < 2; ++pass)
            for (std::uint32_t i = 0; i < 2; ++i) {
                Tile tile = half(i, 0.25f + (pass == 0 ? 0 : offset));
                std::ranges::fill(tile.variance, 0.01f);
                f.place(pass, tile);
            }
        return static_cast<double>(f.film().error()[0]);
    };
    // 4 samples of variance 0.01 twice: (3 * 0.01 + 3 * 0.01) / 7, N^1.5 = 8^1.5.
    CHECK(error_of(0) == doctest::Approx(0.72 * std::sqrt(0.5 * 0.06 / 7 / std::pow(8, 1.5))));
    CHECK(error_of(0.5f) > error_of(0.1f));
    CHECK(error_of(0.1f) > error_of(0));
    CHECK(error_of(2) == error_of(1000)); // above 1 nothing can be seen
}

TEST_CASE("light that was cut is an error that no pass makes less, and is told at once") {
    PassFilm f = film();
    for (std::uint32_t pass = 0; pass < 3; ++pass)
        for (std::uint32_t i = 0; i < 2; ++i) {
            Tile tile = half(i, 0.5f);
            std::ranges::fill(tile.cut, pass == 2 ? 0.5f : 0.125f);
            f.place(pass, tile);
            if (i == 0 && pass == 0)
                CHECK(f.film().error()[0] == 0.125f);
            if (i == 1)
                CHECK(f.film().error()[0] == (pass == 2 ? 0.3125f : 0.125f));
        }
}

} // namespace
} // namespace fraja
