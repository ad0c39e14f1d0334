#include "client/page/overview.hpp"

#include "common/image/quantise.hpp"
#include "common/image_io/picture_codec.hpp"

#include <algorithm>
#include <utility>

namespace fraja::client {

std::uint32_t overview_scale(const PixelRect& region) {
    const std::uint32_t side = std::max(region.width, region.height);
    return std::max(1u, (side + overview_side_max - 1) / overview_side_max);
}

LevelsPicture overview_of(const Film& film, std::uint32_t scale) {
    const PixelRect& region = film.region();
    if (scale == 1)
        return {{region.width, region.height}, quantise(film.pixels())};
    const Extent extent{(region.width + scale - 1) / scale, (region.height + scale - 1) / scale};
    LevelsPicture picture{extent, std::vector<std::uint8_t>(3 * extent.pixel_count())};
    std::vector<float> sums(std::size_t{3} * extent.width);
    auto to = picture.rgb.begin();
    for (std::uint32_t top = 0; top < region.height; top += scale) {
        const std::uint32_t rows = std::min(scale, region.height - top);
        std::ranges::fill(sums, 0.0f);
        for (std::uint32_t y = top; y < top + rows; ++y) {
            const auto row = film.pixels().subspan(std::size_t{3} * y * region.width,
                                                   std::size_t{3} * region.width);
            for (std::uint32_t x = 0; x < region.width; ++x)
                for (std::size_t c = 0; c < 3; ++c)
                    sums[std::size_t{3} * (x / scale) + c] += row[std::size_t{3} * x + c];
        }
        for (std::uint32_t x = 0; x < extent.width; ++x) {
            const std::uint32_t columns = std::min(scale, region.width - x * scale);
            const auto pixels = static_cast<float>(std::uint64_t{rows} * columns);
            for (std::size_t c = 0; c < 3; ++c)
                *to++ = quantise(sums[std::size_t{3} * x + c] / pixels);
        }
    }
    return picture;
}

LevelsPicture cut_out(const Film& film, const PixelRect& part) {
    const PixelRect& region = film.region();
    FRAJA_ASSERT(part.inside(region));
    LevelsPicture picture{{part.width, part.height}, {}};
    picture.rgb.reserve(3 * part.pixel_count());
    for (std::uint32_t y = part.y - region.y; y < part.y - region.y + part.height; ++y) {
        const std::size_t first = std::size_t{y} * region.width + (part.x - region.x);
        const auto row = quantise(film.pixels().subspan(3 * first, std::size_t{3} * part.width));
        picture.rgb.insert(picture.rgb.end(), row.begin(), row.end());
    }
    return picture;
}

Result<http::Body> encode_levels(const LevelsPicture& picture, std::string_view format) {
    const auto codec = picture_codec();
    if (!codec)
        return codec.error();
    const auto bytes =
        (*codec)->encode({.format = format,
                          .extent = picture.extent,
                          .window = {0, 0, picture.extent.width, picture.extent.height},
                          .pixels = std::span<const std::uint8_t>(picture.rgb),
                          .channels = {},
                          .attributes = {}});
    if (!bytes)
        return bytes.error();
    return http::body(std::string(bytes->begin(), bytes->end()));
}

EncodedOnce::EncodedOnce(LevelsPicture levels, std::string format)
    : levels_(std::move(levels)), format_(std::move(format)) {}

Result<http::Body> EncodedOnce::bytes() {
    const std::scoped_lock lock(mutex_);
    if (!bytes_) {
        auto encoded = encode_levels(levels_, format_);
        if (!encoded)
            return encoded.error();
        bytes_ = *std::move(encoded);
        levels_ = {};
    }
    return bytes_;
}

} // namespace fraja::client
