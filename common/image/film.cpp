#include "common/image/film.hpp"

#include "common/base/assert.hpp"

#include <algorithm>

namespace fraja {
Film::Film(Extent size, PixelRect region) : size_(size), region_(region) {
    FRAJA_ASSERT(region.inside(size));
    rgb_.resize(3 * region.pixel_count());
}

void Film::place(const Tile& tile) {
    FRAJA_ASSERT(tile.rect.inside(region_));
    FRAJA_ASSERT(tile.rgb.size() == 3 * tile.rect.pixel_count());
    const std::size_t tile_row = 3 * std::size_t{tile.rect.width};
    const std::size_t film_row = 3 * std::size_t{region_.width};
    const std::size_t left = 3 * std::size_t{tile.rect.x - region_.x};
    for (std::size_t row = 0; row < tile.rect.height; ++row) {
        const std::size_t film_y = tile.rect.y - region_.y + row;
        std::copy_n(tile.rgb.data() + row * tile_row, tile_row,
                    rgb_.data() + film_y * film_row + left);
    }
}

} // namespace fraja
