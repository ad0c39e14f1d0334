// Film: a picture, or a part of one, that tiles are placed on.
#pragma once

#include "common/base/pixel_rect.hpp"
#include "common/image/tile.hpp"

#include <span>
#include <vector>

namespace fraja {

/// Scene-linear RGB of the pixels `region` of a picture of `size`. Black where no tile was placed.
class Film {
public:
    /// What is kept of each pixel beside its colours.
    struct Keeps {
        bool estimates = false; ///< samples and error
        bool layers = false;
    };
    /// `region` must lie inside `size` (asserted); it may be empty.
    Film(Extent size, PixelRect region, Keeps keeps);
    /// The whole picture.
    explicit Film(Extent size) : Film(size, {0, 0, size.width, size.height}) {}
    Film(Extent size, PixelRect region) : Film(size, region, Keeps{}) {}

    /// Copies the tile's pixels, over what was there. It must lie inside the region and hold as
    /// many floats as its rectangle and the film say (asserted: who takes tiles from a network
    /// checks before).
    void place(const Tile& tile);

    [[nodiscard]] Extent size() const { return size_; }
    [[nodiscard]] PixelRect region() const { return region_; }
    /// Row-major from the region's top left: 3 * region.width * region.height floats.
    [[nodiscard]] std::span<const float> pixels() const { return rgb_; }
    /// Likewise, one float a pixel, as in Tile; empty where they are not kept.
    [[nodiscard]] std::span<const float> samples() const { return samples_; }
    [[nodiscard]] std::span<const float> error() const { return error_; }
    /// Likewise a plane for each of layer_names, one after the other.
    [[nodiscard]] std::span<const float> layers() const { return layers_; }

private:
    Extent size_;
    PixelRect region_;
    std::vector<float> rgb_, samples_, error_, layers_;
};

} // namespace fraja
