#include "common/image/pass_film.hpp"

#include "common/base/assert.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace fraja {
namespace {

// Measured on the scenes of tools/bench/time_error.
constexpr double spread_factor = 0.72;

double square(double x) {
    return x * x;
}

/// Of the mean of so many samples, from their own.
double variance_by_spread(double variance, double samples) {
    return square(spread_factor) * variance / (samples * std::sqrt(samples));
}

/// x^1.3, about: by how much the variance of a mean falls when its samples grow.
double gain(double x) {
    return x * std::sqrt(std::sqrt(x));
}

} // namespace

PassFilm::PassFilm(Extent size, PixelRect region, std::vector<std::uint32_t> samples,
                   std::size_t tiles)
    : region_(region), samples_(std::move(samples)), tiles_(tiles), pixels_(region.pixel_count()),
      waiting_(samples_.size()), film_(size, region, {.estimates = true}) {}

void PassFilm::place(std::uint32_t pass, Tile tile) {
    FRAJA_ASSERT(pass >= passes_done_ && pass < samples_.size());
    FRAJA_ASSERT(tile.rect.inside(region_));
    FRAJA_ASSERT(tile.rgb.size() == 3 * tile.rect.pixel_count());
    FRAJA_ASSERT(tile.variance.size() == tile.rect.pixel_count());
    FRAJA_ASSERT(tile.cut.size() == tile.rect.pixel_count());
    if (pass == 0)
        film_.place(seen_first(tile));
    waiting_[pass].push_back(std::move(tile));
    while (passes_done_ < samples_.size() && waiting_[passes_done_].size() == tiles_) {
        for (const Tile& part : std::exchange(waiting_[passes_done_], {}))
            add(part);
        samples_done_ += samples_[passes_done_++];
    }
}

/// A tile of the first pass, as it is.
Tile PassFilm::seen_first(const Tile& tile) const {
    Tile seen{.rect = tile.rect, .rgb = tile.rgb};
    for (std::size_t i = 0; i < tile.variance.size(); ++i) {
        seen.samples.push_back(static_cast<float>(samples_[0]));
        const auto variance = static_cast<double>(tile.variance[i]);
        const auto cut = static_cast<double>(tile.cut[i]);
        seen.error.push_back(
            static_cast<float>(std::sqrt(variance_by_spread(variance, samples_[0]) + cut * cut)));
    }
    return seen;
}

/// Of the next pass to be done.
void PassFilm::add(const Tile& tile) {
    const double before = samples_done_, added = samples_[passes_done_], now = before + added;
    // The mean of all, that of those before, and how far apart they are: the latter's error and
    // that of the new samples show in it, with what weight is known.
    const double share = now / added;
    const double to_variance = before > 0 ? share * share / (gain(share) + gain(now / before)) : 0;
    Tile seen{.rect = tile.rect, .rgb = {}};
    for (std::size_t i = 0; i < tile.variance.size(); ++i) {
        const std::size_t row = tile.rect.y - region_.y + i / tile.rect.width;
        Pixel& pixel =
            pixels_[row * region_.width + (tile.rect.x - region_.x + i % tile.rect.width)];
        double moved = 0, apart = 0; // squares; above 1 nothing can be seen
        for (std::size_t c = 0; c < 3; ++c) {
            const auto new_mean = static_cast<double>(tile.rgb[3 * i + c]);
            const double mean_before = before > 0 ? pixel.rgb[c] / before : new_mean;
            pixel.rgb[c] += added * new_mean;
            const double mean = pixel.rgb[c] / now;
            moved += square(std::min(mean, 1.0) - std::min(mean_before, 1.0)) / 3;
            apart += square(std::min(new_mean, 1.0) - std::min(mean_before, 1.0)) / 3;
            seen.rgb.push_back(static_cast<float>(mean));
        }
        pixel.squares +=
            (added - 1) * static_cast<double>(tile.variance[i]) + apart * before * added / now;
        pixel.cut += added * static_cast<double>(tile.cut[i]);
        const double moved_variance = moved * to_variance;
        pixel.variance_of_mean =
            passes_done_ < 2 ? moved_variance
                             : 0.5 * (moved_variance + pixel.variance_of_mean / gain(now / before));
        const double by_spread = variance_by_spread(pixel.squares / (now - 1), now);
        const double variance =
            passes_done_ == 0 ? by_spread : 0.5 * (pixel.variance_of_mean + by_spread);
        seen.samples.push_back(static_cast<float>(now));
        seen.error.push_back(static_cast<float>(std::sqrt(variance + square(pixel.cut / now))));
    }
    film_.place(seen);
}

} // namespace fraja
