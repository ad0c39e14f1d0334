#include "common/image/quantise.hpp"

#include <algorithm>

namespace fraja {

std::uint8_t quantise(float linear) {
    if (!(linear > 0))
        return 0;
    const float scaled = 255.0f * std::min(1.0f, linear);
    return static_cast<std::uint8_t>(static_cast<double>(scaled) + 0.5);
}

std::vector<std::uint8_t> quantise(std::span<const float> linear) {
    std::vector<std::uint8_t> levels(linear.size());
    std::transform(linear.begin(), linear.end(), levels.begin(),
                   [](float component) { return quantise(component); });
    return levels;
}

} // namespace fraja
