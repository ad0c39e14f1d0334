#include "broker/cost_map.hpp"

#include "tests/support/seeds.hpp"

#include <doctest/doctest.h>
#include <limits>
#include <set>
#include <utility>
#include <vector>

namespace fraja::broker {
namespace {

using protocol::CellGrid;
using protocol::CellRect;

/// 64 x 32 pixels: 4 x 2 spots of 16, in cells of 8.
CostMap map_of_eight() {
    return CostMap(CellGrid({0, 0, 64, 32}, 8));
}

TEST_CASE("a blank map takes every pixel for a ray") {
    const CostMap costs = map_of_eight();
    CHECK(costs.is_blank());
    CHECK(costs.spot_count() == 8);
    CHECK(costs.block_side() == 8);
    CHECK(costs.block_columns() == 1);
    CHECK(costs.block_rows() == 1);
    CHECK(costs.left() == 64 * 32);
    CHECK(costs.work({0, 0, 2, 1}) == 128);
    CHECK(costs.work({1, 1, 6, 3}) == 18 * 64); // across spots
    CHECK(costs.share_done() == 0);
}

TEST_CASE("spots at the borders are as large as what is there") {
    const CostMap costs(CellGrid({10, 10, 100, 70}, 8)); // columns 1..13, rows 1..9
    double pixels = 0;
    for (std::size_t i = 0; i < costs.spot_count(); ++i)
        pixels += costs.work(costs.spot(i));
    CHECK(pixels == 100 * 70);
    CHECK(costs.block_columns() == 2);
    CHECK(costs.block_rows() == 2);
}

TEST_CASE("a probe tells the parts of a picture from one another") {
    CostMap costs = map_of_eight();
    std::vector<double> rays(8, 1);
    rays[5] = 9;
    rays[6] = std::numeric_limits<double>::infinity();
    rays[7] = -3;
    costs.take_probe(rays);
    CHECK_FALSE(costs.is_blank());
    CHECK(costs.work(costs.spot(5)) == 9 * costs.work(costs.spot(0)));
    CHECK(costs.work(costs.spot(6)) == costs.work(costs.spot(0)));
    CHECK(costs.left() == 16 * 16 * (7 + 9));
}

TEST_CASE("what is done tells what its spot costs, and how good the probe is for the others") {
    CostMap costs = map_of_eight();
    std::vector<double> rays(8, 1);
    rays[1] = 2;
    costs.take_probe(rays);
    costs.learn({0, 0, 2, 2}, 3 * 16 * 16); // all of spot 0 was three times as much
    CHECK(costs.work(costs.spot(1)) == doctest::Approx(6 * 16 * 16));
    CHECK(costs.left() == doctest::Approx(3.0 * 16 * 16 * (6 + 2)));
    CHECK(costs.share_done() == doctest::Approx(3.0 / (3 + 3 * 8)));
    costs.learn({2, 0, 2, 1}, 100.0 * 8 * 16); // half of spot 1, and far more than that
    CHECK(costs.work({2, 1, 2, 1}) > 85.0 * 8 * 16);
    CHECK(costs.work({2, 1, 2, 1}) < 110.0 * 8 * 16);
}

TEST_CASE("what is being drawn counts as far as it is, and tells how long the rest will take") {
    CostMap costs = map_of_eight();
    costs.take_probe(std::vector<double>(8, 1));
    const double spot = 16 * 16;
    costs.learn({0, 0, 2, 2}, spot);
    TilesBegun begun{.work = spot / 2, .thought = spot, .expected = spot, .per_s = spot / 4};
    CHECK(costs.share_done(begun) == doctest::Approx(1.5 / 8));
    CHECK(costs.share_per_s(begun) == doctest::Approx(0.25 / 8));
    begun.work = 3 * spot; // it was thought to be one
    begun.expected = 4 * spot;
    CHECK(costs.share_done(begun) == doctest::Approx((1.0 + 3) / (1 + 7 * 2.5)));
    CHECK(costs.share_per_s(begun) == doctest::Approx(0.25 / (1 + 7 * 2.5)));
    CHECK(costs.share_per_s({}) == 0);
}

TEST_CASE("the work of a tile of several spots was where it was thought to be") {
    CostMap costs = map_of_eight();
    costs.take_probe({1, 3, 1, 1, 1, 1, 1, 1});
    costs.learn({0, 0, 4, 1}, 2.0 * (8 * 16 * 1 + 8 * 16 * 3)); // half of spots 0 and 1
    CHECK(costs.work({2, 1, 2, 1}) == doctest::Approx(3 * costs.work({0, 1, 2, 1})));
}

TEST_CASE("what lies beside something dear may be dear, too, until it is known") {
    CostMap costs = map_of_eight();
    costs.learn({2, 0, 2, 2}, 100.0 * 16 * 16); // spot 1
    costs.learn({6, 0, 2, 2}, 1.0 * 16 * 16);   // spot 3
    CHECK(costs.risk(costs.spot(0)) > .4 * costs.work(costs.spot(1)));
    CHECK(costs.risk(costs.spot(6)) > .4 * costs.work(costs.spot(1))); // across a corner
    CHECK(costs.risk(costs.spot(7)) == costs.work(costs.spot(7)));
    CHECK(costs.risk(costs.spot(3)) == costs.work(costs.spot(3)));
}

TEST_CASE("where little is done, its surroundings tell how good the probe is") {
    CostMap costs(CellGrid({0, 0, 512, 512}, 16)); // 8 x 8 blocks of 4 x 4 spots
    std::vector<double> rays(costs.spot_count());
    for (std::size_t i = 0; i < rays.size(); ++i)
        rays[i] = 2 + static_cast<double>(i % 3);
    costs.take_probe(rays);
    const auto thought = [&](std::uint32_t column) {
        return costs.work({column, 16, 1, 1}) / rays[16 * 32 + column];
    };
    for (std::uint32_t row = 0; row < 32; row += 4)
        for (std::uint32_t column = 0; column < 32; column += 4)
            costs.learn({column, row, 1, 1}, // on the left ten times as much as it says
                        (column < 16 ? 10 : 1) * 256.0 * rays[row * 32 + column]);
    CHECK(thought(5) > 8.5 * 256);
    CHECK(thought(5) <= 10 * 256);
    CHECK(thought(25) < 2.0 * 256);
    CHECK(thought(25) >= 1 * 256);
    CHECK(costs.left() == doctest::Approx(15 * costs.done()).epsilon(0.02));
}

TEST_CASE("work that was done keeps its worth when rays get cheaper") {
    CostMap costs = map_of_eight();
    costs.take_probe(std::vector<double>(8, 1));
    const double spot = 16 * 16;
    costs.learn({0, 0, 2, 2}, spot);
    CHECK(costs.left() == doctest::Approx(7 * spot));
    costs.set_worth(3); // what took a second was a ray, and is three now
    CHECK(costs.done() == doctest::Approx(3 * spot));
    CHECK(costs.left() == doctest::Approx(3 * 7 * spot));
    CHECK(costs.share_done() == doctest::Approx(1.0 / 8));
    costs.learn({2, 0, 2, 2}, 3 * spot);
    CHECK(costs.work(costs.spot(5)) == doctest::Approx(3 * spot));
    CHECK(costs.share_done() == doctest::Approx(2.0 / 8));
    CostMap blank = map_of_eight();
    blank.set_worth(3);
    CHECK(blank.left() == doctest::Approx(8 * spot)); // rays of now, as all that is told
}

TEST_CASE("scattered spots are a small part of a picture, each in another block") {
    for (const auto& [side, count] :
         {std::pair{150u, 0u}, {256u, 12u}, {640u, 80u}, {4096u, 128u}}) {
        CAPTURE(side);
        const CostMap costs(CellGrid({0, 0, side, side}, 2));
        const std::vector<std::size_t> spots = costs.scattered_spots();
        CHECK(spots.size() == count);
        std::set<std::size_t> blocks;
        double x = 0, y = 0;
        for (const std::size_t spot : spots) {
            blocks.insert(costs.block_of(costs.spot(spot)));
            x += costs.spot(spot).column, y += costs.spot(spot).row;
        }
        CHECK(blocks.size() == count);
        if (count > 50) { // in the middle, on the average
            CHECK(x / count == doctest::Approx(side / 4).epsilon(0.05));
            CHECK(y / count == doctest::Approx(side / 4).epsilon(0.05));
        }
    }
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
                std::vector<double> rays(costs.spot_count());
                for (double& r : rays)
                    r = 10 * rng.unit();
                costs.take_probe(rays);
            }
            const double work = 1e3 * rng.unit();
            sum += work;
            costs.learn(grid.at(cells[i]), work);
            CHECK(costs.left() >= 0);
            CHECK(costs.share_done() <= 1);
            if (i % 256 == 100) {
                double left = 0;
                for (std::size_t j = i + 1; j < cells.size(); ++j)
                    left += costs.work(grid.at(cells[j]));
                CHECK(costs.left() == doctest::Approx(left));
            }
        }
        CHECK(costs.done() == doctest::Approx(sum));
        CHECK(costs.left() <= 1e-6 * sum);
    });
}

} // namespace
} // namespace fraja::broker
