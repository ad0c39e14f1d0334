#include "client/page/heat_map.hpp"

#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::client;
using namespace std::chrono_literals;

namespace {

protocol::TileDone tile(const PixelRect& rect, const std::string& worker, Duration elapsed) {
    protocol::TileDone done;
    done.rect = rect;
    done.worker_name = worker;
    done.elapsed = elapsed;
    return done;
}

Srgb8 pixel(const LevelsPicture& picture, std::size_t i) {
    return {picture.rgb[3 * i], picture.rgb[3 * i + 1], picture.rgb[3 * i + 2]};
}

} // namespace

TEST_CASE("a cell's colour is what a pixel of it has cost, from the least to the most") {
    HeatMap map({0, 0, 32, 8}, 8);
    map.add(tile({0, 0, 8, 8}, "ada", 64us));
    map.add(tile({8, 0, 16, 8}, "ada", 12'800us)); // twice as large: 100 us a pixel
    CHECK(map.scale().least == doctest::Approx(1e-6));
    CHECK(map.scale().most == doctest::Approx(1e-4));
    const LevelsPicture costs = map.costs();
    CHECK(costs.extent == Extent{4, 1});
    CHECK(pixel(costs, 0) == cost_colour(0));
    CHECK(pixel(costs, 1) == cost_colour(1));
    CHECK(pixel(costs, 2) == cost_colour(1));
    CHECK(pixel(costs, 3) == Srgb8{}); // not rendered yet
    map.add(tile({24, 0, 8, 8}, "grace", 640us));
    CHECK(pixel(map.costs(), 3) == cost_colour(0.5)); // halfway by factors
    map.add(tile({0, 0, 8, 8}, "ada", 6'336us));      // another pass over it
    CHECK(pixel(map.costs(), 0) == cost_colour(1));
}

TEST_CASE("costs too far apart are seen on the upper end of their scale") {
    HeatMap map({0, 0, 16, 8}, 8);
    map.add(tile({0, 0, 8, 8}, "ada", 0ns));
    map.add(tile({8, 0, 8, 8}, "ada", 64s));
    CHECK(map.scale().least == doctest::Approx(1e-4));
    CHECK(map.scale().most == doctest::Approx(1));
    CHECK(pixel(map.costs(), 0) == cost_colour(0));
}

TEST_CASE("a cell shows who rendered it, and each worker's tiles are counted") {
    HeatMap map({4, 4, 16, 8}, 8); // cells that reach beyond the crop
    CHECK(map.covered() == PixelRect{0, 0, 24, 16});
    map.add(tile({4, 4, 4, 4}, "ada", 1ms));
    map.add(tile({8, 4, 8, 4}, "grace", 1ms));
    map.add(tile({4, 8, 4, 4}, "ada", 1ms));
    const LevelsPicture workers = map.workers();
    CHECK(workers.extent == Extent{3, 2});
    CHECK(pixel(workers, 0) == worker_colour(0));
    CHECK(pixel(workers, 1) == worker_colour(1));
    CHECK(pixel(workers, 3) == worker_colour(0));
    CHECK(pixel(workers, 4) == Srgb8{});
    REQUIRE(map.shares().size() == 2);
    CHECK(map.shares()[0].name == "ada");
    CHECK(map.shares()[0].tiles == 2);
    CHECK(worker_colour(0) != worker_colour(1));
}

TEST_CASE("workers beyond the limit are one") {
    HeatMap map({0, 0, 1000, 1}, 1);
    for (std::uint32_t i = 0; i < 1000; ++i)
        map.add(tile({i, 0, 1, 1}, std::to_string(i), 1ms));
    REQUIRE(map.shares().size() == map_workers_max);
    CHECK(map.shares().back().name == "others");
    CHECK(map.shares().back().tiles == 1000 - map_workers_max + 1);
}

TEST_CASE("colours of costs grow lighter all the way") {
    const auto light = [](const Srgb8& c) { return 0.3 * c[0] + 0.59 * c[1] + 0.11 * c[2]; };
    for (int i = 1; i <= 20; ++i)
        CHECK(light(cost_colour(i / 20.0)) > light(cost_colour((i - 1) / 20.0)));
    CHECK(cost_colour(-1) == cost_colour(0));
    CHECK(cost_colour(2) == cost_colour(1));
}
