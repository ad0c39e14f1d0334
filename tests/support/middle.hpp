// The middle of a picture: what is drawn of it where rays are dear.
#pragma once

#include "common/base/pixel_rect.hpp"

#include <cstdint>

namespace fraja {

/// 1/n of the width and of the height.
[[nodiscard]] inline PixelRect middle_of(Extent size, std::uint32_t n) {
    const std::uint32_t width = size.width / n, height = size.height / n;
    return {(size.width - width) / 2, (size.height - height) / 2, width, height};
}

} // namespace fraja
