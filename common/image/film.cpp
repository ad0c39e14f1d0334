#include "common/image/film.hpp"

#include "common/base/assert.hpp"

#include <algorithm>

namespace fraja {
namespace {

/// Copies the rows of a rectangle into those of a larger one.
void copy_rows(const std::vector<float>& from, PixelRect rect, std::vector<float>& to,
               PixelRect region, std::size_t channels) {
    const std::size_t width = channels * rect.width;
    for (std::size_t row = 0; row < rect.height; ++row)
        std::copy_n(from.data() + row * width, width,
                    to.data() + channels * ((rect.y - region.y + row) * region.width +
                                            (rect.x - region.x)));
}

} // namespace

Film::Film(Extent size, PixelRect region, Keeps keeps) : size_(size), region_(region) {
    FRAJA_ASSERT(region.inside(size));
    rgb_.resize(3 * region.pixel_count());
    if (keeps == Keeps::estimates) {
        samples_.resize(region.pixel_count());
        error_.resize(region.pixel_count());
    }
}

void Film::place(const Tile& tile) {
    FRAJA_ASSERT(tile.rect.inside(region_));
    FRAJA_ASSERT(tile.rgb.size() == 3 * tile.rect.pixel_count());
    copy_rows(tile.rgb, tile.rect, rgb_, region_, 3);
    if (samples_.empty())
        return;
    FRAJA_ASSERT(tile.samples.size() == tile.rect.pixel_count());
    FRAJA_ASSERT(tile.error.size() == tile.rect.pixel_count());
    copy_rows(tile.samples, tile.rect, samples_, region_, 1);
    copy_rows(tile.error, tile.rect, error_, region_, 1);
}

} // namespace fraja
