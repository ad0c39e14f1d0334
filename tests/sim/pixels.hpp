// Pretended pixels: each a hash of its job, pass and place, so that one that is wrong shows.
#pragma once

#include "common/base/bytes.hpp"
#include "common/base/ids.hpp"
#include "common/base/pixel_rect.hpp"
#include "common/protocol/settings.hpp"

#include <cstdint>
#include <vector>

namespace fraja::sim {

struct PictureOf {
    ContentHash scene;
    const protocol::PictureSettings& settings;
    std::uint32_t pass = 0;
};

[[nodiscard]] Bytes pixels_of(const PictureOf& picture, PixelRect rect);
/// Whether these are the pixels.
[[nodiscard]] bool are_pixels_of(const PictureOf& picture, PixelRect rect,
                                 const std::vector<Blob>& blobs);

} // namespace fraja::sim
