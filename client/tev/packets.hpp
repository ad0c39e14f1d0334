// What tev (https://github.com/Tom94/tev) is told over TCP: little endian, nothing padded, each
// packet `u32 length (itself included), u8 type, payload`. It never answers.
#pragma once

#include "common/base/bytes.hpp"
#include "common/base/pixel_rect.hpp"

#include <cstdint>
#include <span>
#include <string_view>

namespace fraja::client::tev {

inline constexpr std::uint16_t port = 14158; ///< where tev listens

// `name` is tev's name of the image, without zeros in it (asserted). Images are R, G, B.

/// A black image; `focus`: tev shows it now.
[[nodiscard]] Bytes create_image(std::string_view name, bool focus, Extent size);
/// A rectangle of an image that was created: 3 floats a pixel, row-major (asserted).
[[nodiscard]] Bytes update_image(std::string_view name, PixelRect rect, std::span<const float> rgb);
/// No harm where there is no such image.
[[nodiscard]] Bytes close_image(std::string_view name);

} // namespace fraja::client::tev
