#include "common/render/reference/highlight.hpp"

#include <algorithm>
#include <cmath>

namespace fraja::reference {
namespace {

double power(double base, std::uint32_t exponent) {
    double result = 1;
    for (; exponent > 0; exponent >>= 1, base *= base)
        if (exponent & 1u)
            result *= base;
    return result;
}

} // namespace

double highlight(double cosine, std::int32_t ns) {
    if (ns >= 0)
        return std::min(highlight_max,
                        power(std::max(0.0, cosine), static_cast<std::uint32_t>(ns)));
    if (!(cosine > 0))
        return 0;
    const auto magnitude = static_cast<std::uint32_t>(-static_cast<std::int64_t>(ns));
    return std::min(highlight_max, 1 / power(cosine, magnitude));
}

} // namespace fraja::reference
