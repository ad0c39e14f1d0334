#include "common/image/quantise.hpp"

#include <doctest/doctest.h>
#include <initializer_list>
#include <limits>

namespace fraja {
namespace {

TEST_CASE("quantise goes through single precision, as Raja does") {
    struct Row {
        double value;
        int level;
    };
    for (const Row& row :
         {Row{0.0, 0}, Row{-0.0, 0}, Row{1.0, 255}, Row{0.5, 128},
          Row{0.34705882152941175, 89}, // 88 in double precision
          Row{0.5 / 255 - 1e-9, 0}, Row{0.5 / 255 + 1e-9, 1}, Row{254.49 / 255, 254},
          Row{254.51 / 255, 255}, Row{1.0000001, 255}, Row{1e30, 255}}) {
        CAPTURE(row.value);
        CHECK(quantise(static_cast<float>(row.value)) == row.level);
    }
}

TEST_CASE("quantise gives a level for what no picture holds") {
    constexpr float infinity = std::numeric_limits<float>::infinity();
    CHECK(quantise(std::numeric_limits<float>::quiet_NaN()) == 0);
    CHECK(quantise(-1.0f) == 0);
    CHECK(quantise(-infinity) == 0);
    CHECK(quantise(infinity) == 255);
    CHECK(quantise(std::numeric_limits<float>::denorm_min()) == 0);
}

TEST_CASE("quantise keeps every level that was read from an 8-bit picture") {
    for (int level = 0; level < 256; ++level) {
        CAPTURE(level);
        CHECK(quantise(static_cast<float>(level) / 255.0f) == level);
    }
}

TEST_CASE("quantise takes pictures, too") {
    const std::vector<float> linear{0.0f, 0.5f, 2.0f};
    CHECK(quantise(linear) == std::vector<std::uint8_t>{0, 128, 255});
}

} // namespace
} // namespace fraja
