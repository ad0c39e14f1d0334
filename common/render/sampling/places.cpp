#include "common/render/sampling/places.hpp"

#include "common/render/sampling/owen_sobol.hpp"

#include <algorithm>
#include <cmath>

namespace fraja {
namespace {

constexpr double just_below_half = 0x1.fffffffffffffp-2;

/// From 0..1 to -0.5..1.5, so that a place's density is a tent over the pixel's middle.
double through_tent(double u) {
    return u < 0.5 ? std::sqrt(2 * u) - 0.5 : 1.5 - std::sqrt(2 * (1 - u));
}

} // namespace

SamplePlaces::SamplePlaces(const RenderSettings& settings, PixelRect rect, bool two_pictures)
    : settings_(settings), rect_(rect), two_pictures_(two_pictures) {
    if (settings.low_discrepancy())
        return;
    // Raja's: the pixel's centre, or a regular grid. FORMAT.md, section 5.
    const std::uint64_t n = settings.aa;
    const auto [width, height] = settings.size;
    dx_ = 1.0 / static_cast<double>(n * width), dy_ = 1.0 / static_cast<double>(n * height);
    const auto start = [&](std::uint32_t pixel, std::uint32_t size, double step) {
        return settings.aa == 0 ? (pixel + 0.5) / size
                                : 0.5 * step + static_cast<double>(pixel) / size;
    };
    for (std::uint32_t i = 0; i < rect.width; ++i)
        left_.push_back(start(rect.x + i, width, dx_));
    for (std::uint32_t i = 0; i < rect.height; ++i)
        top_.push_back(start(rect.y + i, height, dy_));
}

void SamplePlaces::fill(std::uint32_t column, std::uint32_t row, std::uint64_t first,
                        std::uint32_t count, double* x, double* y) const {
    if (!settings_.low_discrepancy())
        return fill_grid(column, row, first, count, x, y);
    const std::uint32_t pixel = mixed(std::uint64_t{row} << 32 | column);
    const OwenSobol points(
        settings_.seed == 0 ? pixel : mixed(std::uint64_t{settings_.seed} << 32 | pixel));
    const auto index = static_cast<std::uint32_t>(first);
    for (std::uint32_t i = 0; i < count; ++i) {
        SquarePoint at = points(index + i);
        if (settings_.filter == Filter::tent)
            at = {through_tent(at.x), through_tent(at.y)};
        x[i] = (column + at.x) / settings_.size.width;
        y[i] = (row + at.y) / settings_.size.height;
        if (two_pictures_ && settings_.filter != Filter::box) {
            const bool right = (column + 0.5) / settings_.size.width >= 0.5;
            x[i] = right ? std::max(x[i], 0.5) : std::min(x[i], just_below_half);
        }
    }
}

/// Column by column.
void SamplePlaces::fill_grid(std::uint32_t column, std::uint32_t row, std::uint64_t first,
                             std::uint32_t count, double* x, double* y) const {
    const double left = left_[column - rect_.x], top = top_[row - rect_.y];
    if (settings_.aa == 0) {
        *x = left, *y = top;
        return;
    }
    const std::uint64_t n = settings_.aa;
    std::uint64_t kx = first / n, ky = first % n;
    for (std::uint32_t i = 0; i < count; ++i) {
        x[i] = left + static_cast<double>(kx) * dx_;
        y[i] = top + static_cast<double>(ky) * dy_;
        if (++ky == n)
            ky = 0, ++kx;
    }
}

} // namespace fraja
