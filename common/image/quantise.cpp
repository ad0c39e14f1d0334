#include "common/image/quantise.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace fraja {

std::uint8_t quantise(float linear) {
    if (!(linear > 0))
        return 0;
    const float scaled = 255.0f * std::min(1.0f, linear);
    return static_cast<std::uint8_t>(static_cast<double>(scaled) + 0.5);
}

namespace {

/// The radiance from which on a level is the nearest: of level n at n - 1. As floats, so that a
/// mathematical library whose last digit is another makes the same levels.
using Thresholds = std::array<float, 255>;

double radiance_of_srgb(double encoded) {
    return encoded <= 0.04045 ? encoded / 12.92 : std::pow((encoded + 0.055) / 1.055, 2.4);
}

Thresholds thresholds_of(Transfer transfer) {
    Thresholds thresholds{};
    for (std::size_t i = 0; i < thresholds.size(); ++i) {
        const double encoded = (static_cast<double>(i) + 0.5) / levels_per_unit;
        thresholds[i] =
            static_cast<float>(transfer == Transfer::srgb ? radiance_of_srgb(encoded) : encoded);
    }
    return thresholds;
}

std::uint8_t quantise_by(const Thresholds& thresholds, float linear) {
    if (!(linear > 0))
        return 0;
    const auto above = std::upper_bound(thresholds.begin(), thresholds.end(), linear);
    return static_cast<std::uint8_t>(above - thresholds.begin());
}

} // namespace

std::vector<std::uint8_t> quantise(std::span<const float> linear, Transfer transfer) {
    std::vector<std::uint8_t> levels(linear.size());
    if (transfer == Transfer::raja) {
        std::ranges::transform(linear, levels.begin(), [](float c) { return quantise(c); });
    } else {
        const Thresholds thresholds = thresholds_of(transfer);
        std::ranges::transform(linear, levels.begin(),
                               [&](float c) { return quantise_by(thresholds, c); });
    }
    return levels;
}

} // namespace fraja
