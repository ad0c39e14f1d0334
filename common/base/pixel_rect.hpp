// Rectangles of pixels.
#pragma once

#include <cstddef>
#include <cstdint>

namespace fraja {

/// A size in pixels.
struct Extent {
    std::uint32_t width = 0, height = 0;
    friend bool operator==(const Extent&, const Extent&) = default;
    [[nodiscard]] std::uint64_t pixel_count() const { return std::uint64_t{width} * height; }
};

/// The pixels x..x+width-1 (from the left) by y..y+height-1 (from the top), from 0.
struct PixelRect {
    std::uint32_t x = 0, y = 0, width = 0, height = 0;
    friend bool operator==(const PixelRect&, const PixelRect&) = default;
    [[nodiscard]] std::uint64_t pixel_count() const { return std::uint64_t{width} * height; }
    [[nodiscard]] bool empty() const { return width == 0 || height == 0; }
    /// Whether every pixel of this lies in a picture of that size. Overflow is no trap.
    [[nodiscard]] bool inside(Extent e) const {
        return std::uint64_t{x} + width <= e.width && std::uint64_t{y} + height <= e.height;
    }
    /// Whether every pixel of this is one of `r`.
    [[nodiscard]] bool inside(const PixelRect& r) const {
        return x >= r.x && y >= r.y && std::uint64_t{x} + width <= std::uint64_t{r.x} + r.width &&
               std::uint64_t{y} + height <= std::uint64_t{r.y} + r.height;
    }
};

/// Of a grid of squares from the picture's top left, those that a rectangle lies in: from the first
/// column and row on, so many. `side` must not be 0; of an empty rectangle there are none.
[[nodiscard]] constexpr PixelRect cells_of(const PixelRect& r, std::uint32_t side) {
    const auto count = [side](std::uint32_t from, std::uint32_t length) {
        return static_cast<std::uint32_t>(
            length == 0 ? 0 : (std::uint64_t{from} + length - 1) / side - from / side + 1);
    };
    return {r.x / side, r.y / side, count(r.x, r.width), count(r.y, r.height)};
}

} // namespace fraja
