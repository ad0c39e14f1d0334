#include "common/image/quantise.hpp"

#include <cmath>
#include <cstdint>
#include <doctest/doctest.h>
#include <initializer_list>
#include <limits>
#include <vector>

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

TEST_CASE("every level of every transfer is the one nearest to what it stands for") {
    for (int level = 0; level < 256; ++level) {
        CAPTURE(level);
        const double encoded = level / 255.0;
        const double decoded =
            encoded <= 0.04045 ? encoded / 12.92 : std::pow((encoded + 0.055) / 1.055, 2.4);
        const float srgb[] = {static_cast<float>(decoded)};
        CHECK(quantise(srgb, Transfer::srgb).front() == level);
        const float linear[] = {static_cast<float>(encoded)};
        CHECK(quantise(linear, Transfer::linear).front() == level);
    }
    const std::vector<float> some{0.0031308f, 0.18f, 0.5f};
    CHECK(quantise(some, Transfer::srgb) == std::vector<std::uint8_t>{10, 118, 188});
}

TEST_CASE("raja's levels are by single precision, linear ones by what is nearest") {
    const std::vector<float> between{0.34705882352941175f}; // 88.5 of 255, a little above as float
    CHECK(quantise(between) == std::vector<std::uint8_t>{89});
    const std::vector<float> below{std::nextafter(static_cast<float>(88.5 / 255), 0.0f)};
    CHECK(quantise(below, Transfer::linear) == std::vector<std::uint8_t>{88});
}

TEST_CASE("no transfer leaves the range, whatever the light") {
    constexpr float infinity = std::numeric_limits<float>::infinity();
    const std::vector<float> light{-1.0f, -infinity, std::numeric_limits<float>::quiet_NaN(), 7.0f,
                                   infinity};
    for (const Transfer transfer : {Transfer::raja, Transfer::srgb, Transfer::linear})
        CHECK(quantise(light, transfer) == std::vector<std::uint8_t>{0, 0, 0, 255, 255});
}

} // namespace
} // namespace fraja
