// Where in a pixel rays are sent, and how they are averaged. FORMAT.md, section 5.
#pragma once

#include "common/base/pixel_rect.hpp"
#include "common/math/vec.hpp"

#include <cstdint>
#include <optional>

namespace fraja::reference {

struct Pixel {
    std::uint32_t column = 0, row = 0; ///< from the picture's top left
};

/// Raja's Basic sampler: the pixel's centre. Its Diadic one draws the same pixels in another order.
template <class Radiance>
[[nodiscard]] std::optional<Rgb> sample_center(Extent size, Pixel pixel, Radiance&& radiance) {
    return radiance((pixel.column + 0.5) / size.width, (pixel.row + 0.5) / size.height);
}

/// Raja's naive supersampling: n x n rays on a regular grid, column by column, averaged before
/// anything is clamped.
template <class Radiance>
[[nodiscard]] std::optional<Rgb> sample_grid(Extent size, Pixel pixel, std::uint32_t n,
                                             Radiance&& radiance) {
    const double dx = 1.0 / static_cast<double>(std::uint64_t{n} * size.width);
    const double dy = 1.0 / static_cast<double>(std::uint64_t{n} * size.height);
    const double left = 0.5 * dx + static_cast<double>(pixel.column) / size.width;
    const double top = 0.5 * dy + static_cast<double>(pixel.row) / size.height;
    Rgb sum{};
    for (std::uint32_t kx = 0; kx < n; ++kx)
        for (std::uint32_t ky = 0; ky < n; ++ky) {
            const std::optional<Rgb> sample = radiance(left + kx * dx, top + ky * dy);
            if (!sample)
                return std::nullopt;
            sum += *sample;
        }
    return sum * (1.0 / static_cast<double>(std::uint64_t{n} * n));
}

/// The radiance of a pixel. radiance(x, y) is asked at places of the whole picture, from (0, 0) at
/// the top left to (1, 1), and answers std::optional<Rgb>: nothing once it has given up.
template <class Radiance>
[[nodiscard]] std::optional<Rgb> sample_pixel(Extent size, Pixel pixel, std::uint32_t aa,
                                              Radiance&& radiance) {
    return aa == 0 ? sample_center(size, pixel, radiance) : sample_grid(size, pixel, aa, radiance);
}

} // namespace fraja::reference
