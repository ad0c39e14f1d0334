#include "client/preview/blocks.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdlib>
#include <fmt/core.h>
#include <span>
#include <string_view>
#include <tuple>

namespace fraja::client {
namespace {

constexpr std::string_view upper_half = "\u2580";

using Pixel = std::span<const std::uint8_t, 3>;

std::string color(char ground, Pixel p, ColorDepth depth) {
    if (depth == ColorDepth::direct)
        return fmt::format("\x1b[{}8;2;{};{};{}m", ground, p[0], p[1], p[2]);
    return fmt::format("\x1b[{}8;5;{}m", ground, indexed_color(p[0], p[1], p[2]));
}

int distance(int a, int b) {
    return (a - b) * (a - b);
}

} // namespace

std::uint8_t indexed_color(std::uint8_t r, std::uint8_t g, std::uint8_t b) {
    // Entries 16 to 231 are a cube of 6 levels, 232 to 255 greys from 8 to 238.
    constexpr std::array cube = {0, 95, 135, 175, 215, 255};
    const auto nearest = [&](int level) {
        return static_cast<int>(
            std::ranges::min_element(cube, {}, [&](int c) { return std::abs(c - level); }) -
            cube.begin());
    };
    const int ri = nearest(r), gi = nearest(g), bi = nearest(b);
    const auto of = [&](int i) { return cube[static_cast<std::size_t>(i)]; };
    const int grey_index = std::clamp(((r + g + b) / 3 - 8 + 5) / 10, 0, 23);
    const int grey = 8 + 10 * grey_index;
    const int by_cube = distance(r, of(ri)) + distance(g, of(gi)) + distance(b, of(bi));
    const int by_grey = distance(r, grey) + distance(g, grey) + distance(b, grey);
    return static_cast<std::uint8_t>(by_grey < by_cube ? 232 + grey_index
                                                       : 16 + 36 * ri + 6 * gi + bi);
}

std::string blocks_image(const LevelsPicture& levels, ColorDepth depth) {
    const auto [width, height] = std::tuple(levels.extent.width, levels.extent.height);
    const auto pixel = [&](std::uint32_t x, std::uint32_t y) {
        return Pixel(levels.rgb.data() + 3 * (std::size_t{y} * width + x), 3);
    };
    std::string text;
    for (std::uint32_t y = 0; y < height; y += 2) {
        std::string upper, lower; // as they are now
        for (std::uint32_t x = 0; x < width; ++x) {
            if (std::string next = color('3', pixel(x, y), depth); next != upper)
                text += upper = std::move(next);
            if (y + 1 < height)
                if (std::string next = color('4', pixel(x, y + 1), depth); next != lower)
                    text += lower = std::move(next);
            text += upper_half;
        }
        text += y + 2 < height ? "\x1b[0m\r\n" : "\x1b[0m";
    }
    return text;
}

} // namespace fraja::client
