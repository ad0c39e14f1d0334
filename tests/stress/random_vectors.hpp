// Numbers that stress cases are made of.
#pragma once

#include "common/base/rng.hpp"
#include "common/math/vec.hpp"

#include <cmath>

namespace fraja::stress {

/// Unit, every direction as often.
inline Vec3 direction(Rng& rng) {
    for (;;) {
        const double x = rng.between(-1, 1), y = rng.between(-1, 1);
        const Vec3 v{x, y, rng.between(-1, 1)};
        if (length(v) > 0.1 && length(v) < 1)
            return normalized(v);
    }
}
/// From 10^low to 10^high, every magnitude as often.
inline double magnitude_between(Rng& rng, double low, double high) {
    return std::pow(10.0, rng.between(low, high));
}

} // namespace fraja::stress
