// What viewers of a job are shown at one moment, encoded when the first of them asks.
#pragma once

#include "common/base/result.hpp"
#include "common/http/message.hpp"
#include "common/image/film.hpp"
#include "common/image_io/picture_file.hpp"

#include <cstdint>
#include <mutex>
#include <string>
#include <string_view>

namespace fraja::client {

/// What one answer's picture has at most; a larger film is shown smaller.
inline constexpr std::uint32_t overview_side_max = 2048;

/// A film is shown by squares of so many pixels' sides, that its sides fit. 1: pixel by pixel.
[[nodiscard]] std::uint32_t overview_scale(const PixelRect& region);
/// The film's region by such squares: each the mean of its light, then quantised.
[[nodiscard]] LevelsPicture overview_of(const Film& film, std::uint32_t scale);
/// The pixels of a film, as they are. They must lie in its region (asserted).
[[nodiscard]] LevelsPicture cut_out(const Film& film, const PixelRect& part);

/// As a file's bytes: "jpg", "png". Loads what encodes pictures (0.25 s, once). Errors: io.
[[nodiscard]] Result<http::Body> encode_levels(const LevelsPicture& picture,
                                               std::string_view format);

/// A picture that stays as it is. Any thread may ask for it; however many do, it is encoded once.
class EncodedOnce {
public:
    EncodedOnce(LevelsPicture levels, std::string format);
    [[nodiscard]] Result<http::Body> bytes();

private:
    std::mutex mutex_;     // guards all
    LevelsPicture levels_; ///< until it is encoded
    std::string format_;
    http::Body bytes_;
};

} // namespace fraja::client
