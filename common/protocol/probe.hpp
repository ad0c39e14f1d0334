// A probe: a few rays that tell how much work a picture's parts are.
#pragma once

#include "common/base/pixel_rect.hpp"

#include <algorithm>
#include <cstdint>

namespace fraja::protocol {

/// Squares of `side` pixels from the rect's top left, as far as they lie in it: so many. `side`
/// must not be 0.
[[nodiscard]] constexpr std::uint64_t probe_squares(const PixelRect& rect, std::uint32_t side) {
    const auto count = [side](std::uint32_t length) {
        return (std::uint64_t{length} + side - 1) / side;
    };
    return count(rect.width) * count(rect.height);
}

/// The one of that number, row by row.
[[nodiscard]] constexpr PixelRect probe_square(const PixelRect& rect, std::uint32_t side,
                                               std::uint64_t number) {
    const std::uint64_t columns = (std::uint64_t{rect.width} + side - 1) / side;
    const auto x = static_cast<std::uint32_t>(number % columns * side);
    const auto y = static_cast<std::uint32_t>(number / columns * side);
    return {rect.x + x, rect.y + y, std::min(side, rect.width - x),
            std::min(side, rect.height - y)};
}

} // namespace fraja::protocol
