// A picture with a time limit is drawn in passes over all of it, as many as there is time for.
#pragma once

#include "common/protocol/settings.hpp"

#include <cstdint>

namespace fraja::protocol {

/// Samples first .. first + count - 1 of every pixel.
struct Pass {
    std::uint32_t first = 0, count = 0;
};

/// The first passes have 4 samples each; then come two of 8, two of 16, and so on. After the second
/// the samples grow by a third or by a half with each pass, so what one that is not finished has
/// cost is never more than a third of all.
[[nodiscard]] constexpr Pass pass_of(std::uint32_t index) {
    const auto begin = [](std::uint32_t i) -> std::uint32_t {
        return i < 2 ? 4 * i : (i % 2 == 0 ? 8u : 12u) << (i - 2) / 2;
    };
    return {begin(index), begin(index + 1) - begin(index)};
}

/// How often a picture's pixels are drawn, at most: 1 without a time limit.
[[nodiscard]] inline std::uint32_t pass_count(const PictureSettings& settings) {
    if (!settings.limited_in_time())
        return 1;
    std::uint32_t count = 1;
    while (pass_of(count).first + pass_of(count).count <= settings.max_samples)
        ++count;
    return count;
}

} // namespace fraja::protocol
