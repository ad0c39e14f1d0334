// WorkMap: what the parts of a pretended picture cost.
#pragma once

#include "common/base/pixel_rect.hpp"

#include <cstdint>
#include <vector>

namespace fraja::sim {

/// Rays by units: squares of a grid from the picture's top left, less at its borders. Within a unit
/// all pixels cost the same.
class WorkMap {
public:
    WorkMap() = default;
    /// `rays` of each unit, row by row.
    WorkMap(Extent size, std::uint32_t unit_side, const std::vector<double>& rays);

    /// Within the picture.
    [[nodiscard]] double rays(const PixelRect& rect) const;
    [[nodiscard]] double rays() const { return rays({0, 0, size_.width, size_.height}); }

private:
    [[nodiscard]] double sum_before(std::uint32_t x, std::uint32_t y) const;

    Extent size_{};
    std::uint32_t side_ = 1, columns_ = 0, rows_ = 0;
    std::vector<double> sums_; // of all units above and left of a corner
};

} // namespace fraja::sim
