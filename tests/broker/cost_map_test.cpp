#include "broker/cost_map.hpp"

#include "tests/support/seeds.hpp"

#include <doctest/doctest.h>
#include <limits>
#include <utility>
#include <vector>

namespace fraja::broker {
namespace {

using protocol::CellGrid;
using protocol::CellRect;

/// 256 x 128 pixels: 4 x 2 blocks of 64, in cells of 8.
CostMap map_of_eight() {
    return CostMap(CellGrid({0, 0, 256, 128}, 8));
}

TEST_CASE("a blank map takes every pixel for a ray") {
    const CostMap costs = map_of_eight();
    CHECK(costs.is_blank());
    CHECK(costs.columns() == 4);
    CHECK(costs.rows() == 2);
    CHECK(costs.block_side() == 8);
    CHECK(costs.left() == 256 * 128);
    CHECK(costs.work({0, 0, 2, 1}) == 128);
    CHECK(costs.share_done() == 0);
}

TEST_CASE("blocks at the borders are as large as what is there") {
    const CostMap costs(CellGrid({10, 10, 100, 70}, 8)); // columns 1..13, rows 1..9
    double pixels = 0;
    for (std::size_t b = 0; b < std::size_t{costs.columns()} * costs.rows(); ++b) {
        CHECK(costs.block_of(costs.block(b)) == b);
        pixels += costs.work(costs.block(b));
    }
    CHECK(pixels == 100 * 70);
}

TEST_CASE("a probe tells the parts of a picture from one another") {
    CostMap costs = map_of_eight();
    std::vector<double> rays(8, 1);
    rays[5] = 9;
    rays[6] = std::numeric_limits<double>::infinity();
    rays[7] = -3;
    costs.take_probe(rays);
    CHECK_FALSE(costs.is_blank());
    CHECK(costs.work(costs.block(5)) == 9 * costs.work(costs.block(0)));
    CHECK(costs.work(costs.block(6)) == costs.work(costs.block(0)));
    CHECK(costs.left() == 64 * 64 * (7 + 9));
}

TEST_CASE("what is done tells what its block costs, and how good the probe is for the others") {
    CostMap costs = map_of_eight();
    std::vector<double> rays(8, 1);
    rays[1] = 2;
    costs.take_probe(rays);
    costs.learn({0, 0, 8, 8}, 3 * 64 * 64); // all of block 0 was three times as much
    CHECK(costs.work(costs.block(1)) == doctest::Approx(6 * 64 * 64));
    CHECK(costs.left() == doctest::Approx(3.0 * 64 * 64 * (6 + 2)));
    CHECK(costs.share_done() == doctest::Approx(3.0 / (3 + 3 * 8)));
    costs.learn({8, 0, 8, 4}, 100.0 * 32 * 64); // half of block 1, and far more than that
    CHECK(costs.work({8, 4, 8, 4}) > 90.0 * 32 * 64);
    CHECK(costs.work({8, 4, 8, 4}) < 110.0 * 32 * 64);
}

TEST_CASE("whatever is learnt in whatever order, in the end nothing is left") {
    for_each_seed(100, [](Rng& rng) {
        const PixelRect crop{static_cast<std::uint32_t>(rng.below(100)),
                             static_cast<std::uint32_t>(rng.below(100)),
                             1 + static_cast<std::uint32_t>(rng.below(300)),
                             1 + static_cast<std::uint32_t>(rng.below(300))};
        const CellGrid grid(crop, 1u << (1 + rng.below(5)));
        CostMap costs(grid);
        std::vector<std::uint64_t> cells(grid.count());
        for (std::uint64_t i = 0; i < cells.size(); ++i)
            cells[i] = i;
        for (std::size_t i = cells.size(); i > 1; --i)
            std::swap(cells[i - 1], cells[rng.below(i)]);
        double sum = 0;
        const std::size_t probed_at = rng.below(cells.size());
        for (std::size_t i = 0; i < cells.size(); ++i) {
            if (i == probed_at) {
                std::vector<double> rays(std::size_t{costs.columns()} * costs.rows());
                for (double& r : rays)
                    r = 10 * rng.unit();
                costs.take_probe(rays);
            }
            const double work = 1e3 * rng.unit();
            sum += work;
            costs.learn(grid.at(cells[i]), work);
            CHECK(costs.left() >= 0);
            CHECK(costs.share_done() <= 1);
        }
        CHECK(costs.done() == doctest::Approx(sum));
        CHECK(costs.left() <= 1e-6 * sum);
    });
}

} // namespace
} // namespace fraja::broker
