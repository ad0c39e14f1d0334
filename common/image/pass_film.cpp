#include "common/image/pass_film.hpp"

#include "common/base/assert.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace fraja {
namespace {

// Measured on the scenes of tools/bench/time_error.
constexpr double spread_factor = 0.72;

/// x^1.3, about: by how much the variance of a mean falls when its samples grow.
double gain(double x) {
    return x * std::sqrt(std::sqrt(x));
}

} // namespace

PassFilm::PassFilm(Extent size, PixelRect region, std::vector<std::uint32_t> samples,
                   std::size_t tiles)
    : region_(region), samples_(std::move(samples)), tiles_(tiles), pixels_(region.pixel_count()),
      waiting_(samples_.size()), film_(size, region, Film::Keeps::estimates) {}

void PassFilm::place(std::uint32_t pass, Tile tile) {
    FRAJA_ASSERT(pass >= passes_done_ && pass < samples_.size());
    FRAJA_ASSERT(tile.rect.inside(region_));
    FRAJA_ASSERT(tile.rgb.size() == 3 * tile.rect.pixel_count());
    FRAJA_ASSERT(tile.squares.size() == tile.rect.pixel_count());
    if (pass == 0) // to be seen
        film_.place({.rect = tile.rect,
                     .rgb = tile.rgb,
                     .samples = std::vector<float>(tile.rect.pixel_count(),
                                                   static_cast<float>(samples_[0])),
                     .error = std::vector<float>(tile.rect.pixel_count())});
    waiting_[pass].push_back(std::move(tile));
    while (passes_done_ < samples_.size() && waiting_[passes_done_].size() == tiles_) {
        for (const Tile& part : std::exchange(waiting_[passes_done_], {}))
            add(part);
        samples_done_ += samples_[passes_done_++];
    }
}

/// Of the next pass to be done.
void PassFilm::add(const Tile& tile) {
    const double before = samples_done_, added = samples_[passes_done_], now = before + added;
    // The mean of all, that of those before, and how far apart they are: the latter's error and
    // that of the new samples show in it, with what weight is known.
    const double share = now / added;
    const double to_variance = before > 0 ? share * share / (gain(share) + gain(now / before)) : 0;
    Tile seen{.rect = tile.rect, .rgb = {}};
    for (std::size_t i = 0; i < tile.squares.size(); ++i) {
        const std::size_t row = tile.rect.y - region_.y + i / tile.rect.width;
        Pixel& pixel =
            pixels_[row * region_.width + (tile.rect.x - region_.x + i % tile.rect.width)];
        double moved = 0, square_of_mean = 0;
        for (std::size_t c = 0; c < 3; ++c) {
            const double mean_before = before > 0 ? pixel.rgb[c] / before : 0;
            pixel.rgb[c] += added * static_cast<double>(tile.rgb[3 * i + c]);
            const double mean = pixel.rgb[c] / now;
            moved += (mean - mean_before) * (mean - mean_before) / 3;
            square_of_mean += mean * mean / 3;
            seen.rgb.push_back(static_cast<float>(mean));
        }
        pixel.squares += added * static_cast<double>(tile.squares[i]);
        const double moved_variance = moved * to_variance;
        pixel.variance = passes_done_ < 2
                             ? moved_variance
                             : 0.5 * (moved_variance + pixel.variance / gain(now / before));
        const double spread_squared =
            std::max(pixel.squares - now * square_of_mean, 0.0) / (now - 1);
        const double by_spread =
            spread_factor * spread_factor * spread_squared / (now * std::sqrt(now));
        seen.samples.push_back(static_cast<float>(now));
        seen.error.push_back(static_cast<float>(
            std::sqrt(passes_done_ == 0 ? by_spread : 0.5 * (pixel.variance + by_spread))));
    }
    film_.place(seen);
}

} // namespace fraja
