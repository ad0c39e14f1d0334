// Sobol's points after Owen's scrambling: how evenly they lie, whatever the seed.
#include "common/render/sampling/owen_sobol.hpp"

#include "tests/support/seeds.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <doctest/doctest.h>
#include <set>
#include <vector>

namespace fraja {
namespace {

#ifdef FRAJA_INSTRUMENTED
constexpr std::uint64_t seeds = 5;
#else
constexpr std::uint64_t seeds = 50;
#endif

std::vector<SquarePoint> points(std::uint32_t seed, std::uint32_t first, std::uint32_t count) {
    const OwenSobol sequence(seed);
    std::vector<SquarePoint> all;
    for (std::uint32_t i = 0; i < count; ++i)
        all.push_back(sequence(first + i));
    return all;
}

/// Of the square cut into so many columns and rows, no part has two.
bool all_apart(const std::vector<SquarePoint>& points, std::uint32_t columns, std::uint32_t rows) {
    std::vector<bool> taken(std::size_t{columns} * rows);
    for (const SquarePoint& p : points) {
        const auto column = static_cast<std::size_t>(p.x * columns);
        const auto row = static_cast<std::size_t>(p.y * rows);
        if (column >= columns || row >= rows || taken[row * columns + column])
            return false;
        taken[row * columns + column] = true;
    }
    return true;
}

TEST_CASE("2^k points from a multiple of 2^k on: one in each part, however the square is cut") {
    for_each_seed(seeds, [](Rng& rng) {
        const auto seed = static_cast<std::uint32_t>(rng.next());
        for (std::uint32_t k = 0; k <= 8; ++k) {
            const std::uint32_t n = 1u << k;
            const auto anywhere = static_cast<std::uint32_t>(rng.next());
            for (const std::uint32_t from :
                 {0u, n, 3 * n, 1u << 20, (1u << 20) + 5 * n, anywhere / n * n, 0u - n}) {
                CAPTURE(k);
                CAPTURE(from);
                const auto run = points(seed, from, n);
                for (std::uint32_t columns = 1; columns <= n; columns *= 2)
                    CHECK(all_apart(run, columns, n / columns));
            }
        }
    });
}

TEST_CASE("from anywhere else on, points share parts: the promise is no more than it says") {
    std::size_t apart = 0;
    for (std::uint32_t seed = 0; seed < 100; ++seed)
        apart += all_apart(points(seed, 7, 16), 4, 4) ? 1u : 0u;
    CHECK(apart < 50);
}

TEST_CASE("a point lies in the square and not on its edges") {
    for_each_seed(seeds, [](Rng& rng) {
        const OwenSobol sequence(static_cast<std::uint32_t>(rng.next()));
        std::size_t outside = 0;
        for (int i = 0; i < 1'000; ++i) {
            const SquarePoint p = sequence(static_cast<std::uint32_t>(rng.next() >> rng.below(64)));
            outside += p.x > 0 && p.x < 1 && p.y > 0 && p.y < 1 ? 0u : 1u;
        }
        CHECK(outside == 0);
    });
}

TEST_CASE("no two of a seed's points are the same, nor any two seeds' first ones") {
    const auto distinct = [](const std::vector<SquarePoint>& all, double SquarePoint::*coordinate) {
        std::set<double> values;
        for (const SquarePoint& p : all)
            values.insert(p.*coordinate);
        return values.size();
    };
    std::vector<SquarePoint> firsts;
    for (std::uint32_t seed = 0; seed < 1'000; ++seed)
        firsts.push_back(OwenSobol(seed)(0));
    const auto run = points(3, 0, 4096);
    for (const auto coordinate : {&SquarePoint::x, &SquarePoint::y}) {
        CHECK(distinct(run, coordinate) == run.size());
        CHECK(distinct(firsts, coordinate) == firsts.size());
    }
}

TEST_CASE("over all seeds, a point is anywhere alike, its coordinates independent") {
    constexpr std::uint32_t count = 4'000;
    for (const std::uint32_t index : {0u, 1u, 6u, 1u << 20}) {
        CAPTURE(index);
        double x = 0, y = 0, xx = 0, xy = 0;
        for (std::uint32_t seed = 0; seed < count; ++seed) {
            const SquarePoint p = OwenSobol(seed)(index);
            x += p.x, y += p.y, xx += p.x * p.x, xy += p.x * p.y;
        }
        // Within five deviations.
        CHECK(x / count == doctest::Approx(1 / 2.0).epsilon(0.03));
        CHECK(y / count == doctest::Approx(1 / 2.0).epsilon(0.03));
        CHECK(xx / count == doctest::Approx(1 / 3.0).epsilon(0.05));
        CHECK(xy / count == doctest::Approx(1 / 4.0).epsilon(0.06));
    }
}

/// Of the mean of a smooth function, over many seeds: the root of the mean square.
double error_of_mean(std::uint32_t samples) {
    constexpr std::uint32_t tries = 64;
    const double want = (1 - std::exp(-1.0)) * (1 - std::exp(-1.0));
    double sum = 0;
    for (std::uint32_t seed = 0; seed < tries; ++seed) {
        double mean = 0;
        for (const SquarePoint& p : points(seed, 0, samples))
            mean += std::exp(-p.x - p.y) / samples;
        sum += (mean - want) * (mean - want);
    }
    return std::sqrt(sum / tries);
}

TEST_CASE("the mean of a smooth function gets right much faster than with random points") {
    // Random points: 0.035 of four, and 16 times as many for a quarter.
    const double of_few = error_of_mean(16), of_many = error_of_mean(1024);
    CHECK(of_few < 0.005);
    CHECK(of_many < of_few / 100); // 8 if random, 512 at best
}

} // namespace
} // namespace fraja
