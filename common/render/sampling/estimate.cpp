#include "common/render/sampling/estimate.hpp"

#include "common/base/assert.hpp"

#include <algorithm>
#include <cmath>

namespace fraja {
namespace {

// Measured on nine scenes of tools/bench/time_error: the least that keep what --error promises.
constexpr double noise_factor = 0.75, spread_factor = 0.5, unseen_factor = 1.0;
constexpr double reported_factor = 0.72;
/// Of all the light there is, what a ray that was cut would have brought: 0.05 to 0.31 in a dozen
/// scenes with glass and mirrors, root of the mean square over their pixels.
constexpr double light_of_a_ray = 0.3;
/// Of the variance of the mean, when samples are doubled: 2^-1.4.
constexpr double doubling_gain = 0.37892914162759955;
/// How many deviations above 1 a colour must be to be seen as nothing but 1.
constexpr double deviations_to_white = 4;

double square(double x) {
    return x * x;
}

} // namespace

void BaseSamples::add(std::span<const double> rgb, std::span<const std::uint64_t> paths,
                      bool first) {
    if (first)
        path = paths[0];
    for (std::size_t i = 0; i < paths.size(); ++i) {
        one_path = one_path && paths[i] == path;
        for (std::size_t c = 0; c < 3; ++c) {
            const auto value = static_cast<float>(rgb[3 * i + c]);
            low[c] = first && i == 0 ? value : std::min(low[c], value);
            high[c] = first && i == 0 ? value : std::max(high[c], value);
        }
    }
}

void BaseSamples::join(const BaseSamples& other) {
    one_path = one_path && other.one_path && path == other.path;
    for (std::size_t c = 0; c < 3; ++c) {
        low[c] = std::min(low[c], other.low[c]);
        high[c] = std::max(high[c], other.high[c]);
    }
}

double BaseSamples::contrast() const {
    double sum = 0;
    for (std::size_t c = 0; c < 3; ++c)
        if (low[c] < 1)
            sum += square(static_cast<double>(high[c]) - static_cast<double>(low[c]));
    return std::sqrt(sum / 3);
}

void PixelSamples::add(std::span<const double> rgb, std::span<const double> cut) {
    const std::uint32_t quarter = std::max(expected_ / 4, 1u);
    for (std::size_t i = 0; i < rgb.size(); i += 3) {
        FRAJA_ASSERT(count_ < expected_);
        auto& sum = quarters_[std::min(count_++ / quarter, 3u)];
        for (std::size_t c = 0; c < 3; ++c) {
            sum[c] += rgb[i + c];
            squares_[c] += rgb[i + c] * rgb[i + c];
        }
    }
    for (std::size_t i = 0; i < cut.size(); i += 3)
        cut_ += std::max({cut[i], cut[i + 1], cut[i + 2]});
}

void PixelSamples::double_expected() {
    for (std::size_t c = 0; c < 3; ++c) {
        quarters_[0][c] += quarters_[1][c];
        quarters_[1][c] = quarters_[2][c] + quarters_[3][c];
        quarters_[2][c] = quarters_[3][c] = 0;
    }
    expected_ *= 2;
}

void PixelSamples::judge() {
    FRAJA_ASSERT(count_ == expected_);
    for (std::size_t c = 0; c < 3; ++c) {
        const double now = variance_between_quarters(c);
        variance_of_mean_[c] = judged_ ? 0.5 * (now + doubling_gain * variance_of_mean_[c]) : now;
    }
    judged_ = true;
}

std::array<double, 3> PixelSamples::mean() const {
    std::array<double, 3> mean{};
    for (std::size_t c = 0; c < 3; ++c)
        mean[c] =
            ((quarters_[0][c] + quarters_[1][c]) + (quarters_[2][c] + quarters_[3][c])) / count_;
    return mean;
}

/// Of the mean of four runs as good as independent.
double PixelSamples::variance_between_quarters(std::size_t c) const {
    const std::uint32_t quarter = expected_ / 4;
    const double mean = this->mean()[c];
    double sum = 0;
    for (std::size_t k = 0; k < 4; ++k)
        sum += square(quarters_[k][c] / (k < 3 ? quarter : expected_ - 3 * quarter) - mean);
    return sum / (3 * 4);
}

/// Over the colours; what is surely nothing but 1 in a picture counts as 0.
double PixelSamples::visible_mean(const std::array<double, 3>& variances) const {
    const std::array<double, 3> mean = this->mean();
    double sum = 0;
    for (std::size_t c = 0; c < 3; ++c)
        if (mean[c] - deviations_to_white * std::sqrt(variance_of_mean_[c]) < 1)
            sum += variances[c];
    return sum / 3;
}

double PixelSamples::bound(const BaseSamples& around) const {
    const double n = count_, root = std::sqrt(n);
    const double spread = this->spread();
    const double bound = std::max({noise_factor * std::sqrt(visible_mean(variance_of_mean_)),
                                   spread_factor * spread / (root * std::sqrt(root)),
                                   unseen_factor * around.contrast() / (n * root)});
    // Where there is no edge, four samples of a square's quarters are as good as sixteen.
    return around.one_path ? std::min(bound, spread / n) : bound;
}

double PixelSamples::error(const BaseSamples& around) const {
    const double noise = reported_factor * std::sqrt(visible_mean(variance_of_mean_));
    const double n = count_;
    return std::sqrt(square(around.one_path ? std::min(noise, spread() / n) : noise) +
                     square(cut()));
}

double PixelSamples::cut() const {
    return light_of_a_ray * cut_ / count_;
}

double PixelSamples::spread() const {
    const double n = count_;
    const std::array<double, 3> mean = this->mean();
    std::array<double, 3> variances{};
    for (std::size_t c = 0; c < 3; ++c)
        variances[c] = std::max(squares_[c] - n * square(mean[c]), 0.0) / (n - 1);
    return std::sqrt(visible_mean(variances));
}

} // namespace fraja
