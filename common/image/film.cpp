#include "common/image/film.hpp"

#include "common/base/assert.hpp"

#include <algorithm>

namespace fraja {
namespace {

/// Copies the rows of a rectangle into those of a larger one.
void copy_rows(const float* from, PixelRect rect, float* to, PixelRect region,
               std::size_t channels) {
    const std::size_t width = channels * rect.width;
    for (std::size_t row = 0; row < rect.height; ++row)
        std::copy_n(from + row * width, width,
                    to + channels *
                             ((rect.y - region.y + row) * region.width + (rect.x - region.x)));
}

} // namespace

Film::Film(Extent size, PixelRect region, Keeps keeps) : size_(size), region_(region) {
    FRAJA_ASSERT(region.inside(size));
    rgb_.resize(3 * region.pixel_count());
    if (keeps.estimates) {
        samples_.resize(region.pixel_count());
        error_.resize(region.pixel_count());
    }
    if (keeps.layers)
        layers_.resize(layer_names.size() * region.pixel_count());
}

void Film::place(const Tile& tile) {
    FRAJA_ASSERT(tile.rect.inside(region_));
    FRAJA_ASSERT(tile.rgb.size() == 3 * tile.rect.pixel_count());
    const std::size_t pixels = tile.rect.pixel_count();
    copy_rows(tile.rgb.data(), tile.rect, rgb_.data(), region_, 3);
    if (!samples_.empty()) {
        FRAJA_ASSERT(tile.samples.size() == pixels && tile.error.size() == pixels);
        copy_rows(tile.samples.data(), tile.rect, samples_.data(), region_, 1);
        copy_rows(tile.error.data(), tile.rect, error_.data(), region_, 1);
    }
    if (layers_.empty())
        return;
    FRAJA_ASSERT(tile.layers.size() == layer_names.size() * pixels);
    for (std::size_t plane = 0; plane < layer_names.size(); ++plane)
        copy_rows(tile.layers.data() + plane * pixels, tile.rect,
                  layers_.data() + plane * region_.pixel_count(), region_, 1);
}

} // namespace fraja
