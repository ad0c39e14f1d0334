#include "common/render/kernel/exact_angle.hpp"

#include <cmath>
#include <utility>

namespace fraja::kernel {
namespace {

// The compiler's own quadruple precision: additions and multiplications in software, the same bits
// everywhere. Slow, and used once per cone.
#if defined(__SIZEOF_FLOAT128__)
__extension__ using Quad = __float128;
#else
using Quad = long double;
#endif

Quad half_pi() {
    // pi/2 to 120 bits, as the sum of three doubles.
    return static_cast<Quad>(1.5707963267948966) + static_cast<Quad>(6.123233995736766e-17) +
           static_cast<Quad>(-1.497384904859169777e-33);
}

/// Of |x| <= pi/4: the Taylor series, from its last term that counts.
Quad sine_series(Quad x) {
    const Quad x2 = x * x;
    Quad sum = 0;
    for (int k = 31; k >= 3; k -= 2)
        sum = (sum + 1) * -x2 / (k * (k - 1));
    return x * (sum + 1);
}
Quad cosine_series(Quad x) {
    const Quad x2 = x * x;
    Quad sum = 0;
    for (int k = 30; k >= 2; k -= 2)
        sum = (sum + 1) * -x2 / (k * (k - 1));
    return sum + 1;
}

DoubleDouble in_two(Quad x) {
    const auto high = static_cast<double>(x);
    return {high, static_cast<double>(x - static_cast<Quad>(high))};
}

} // namespace

ExactAngle exact_angle(double angle_rad) {
    if (!(std::abs(angle_rad) <= 1e15))
        angle_rad = 0;
    const double quarters = std::nearbyint(angle_rad / 1.5707963267948966);
    const Quad rest = static_cast<Quad>(angle_rad) - static_cast<Quad>(quarters) * half_pi();
    Quad sine = sine_series(rest), cosine = cosine_series(rest);
    // Cosine and sine of the angle itself are those of the rest, exchanged in odd quarters; their
    // signs do not matter to a double cone.
    if (std::fmod(quarters, 2) != 0)
        std::swap(sine, cosine);
    const auto positive = [](Quad x) { return x < 0 ? -x : x; };
    ExactAngle a;
    a.cosine_squared = in_two(cosine * cosine);
    a.tangent = static_cast<double>(positive(sine) / positive(cosine));
    return a;
}

DoubleDouble scaled_length_squared(const double (&a)[3], DoubleDouble f) {
    Quad sum = 0;
    for (const double component : a)
        sum += static_cast<Quad>(component) * static_cast<Quad>(component);
    return in_two(sum * (static_cast<Quad>(f.high) + static_cast<Quad>(f.low)));
}

} // namespace fraja::kernel
