// Where in a pixel samples are taken.
#pragma once

#include "common/render/render.hpp"

#include <cstdint>
#include <vector>

namespace fraja {

/// The places of a picture's samples, all pixels of which have as many, or as many as they need.
class SamplePlaces {
public:
    /// For the pixels of `rect`, which may be empty.
    /// A wide filter does not reach from one of `two_pictures` into the other.
    SamplePlaces(const RenderSettings& settings, PixelRect rect, bool two_pictures);

    /// Samples first .. first + count - 1 of a pixel: places on the screen, as SampleBlock has
    /// them.
    void fill(std::uint32_t column, std::uint32_t row, std::uint64_t first, std::uint32_t count,
              double* x, double* y) const;

private:
    void fill_grid(std::uint32_t column, std::uint32_t row, std::uint64_t first,
                   std::uint32_t count, double* x, double* y) const;

    RenderSettings settings_;
    PixelRect rect_;
    bool two_pictures_;
    // Of a grid, the first sample of each column and row, and the way to the next.
    std::vector<double> left_, top_;
    double dx_, dy_;
};

} // namespace fraja
