// The cosine and sine of a cone's angle, with the same bits on every machine.
#pragma once

namespace fraja::kernel {

/// An unevaluated sum of two doubles: about 106 bits.
struct DoubleDouble {
    double high = 0, low = 0;
};

/// What a cone needs of its angle. The libm of one machine may differ from that of the next in the
/// last bit; this does not. |angle_rad| at most 1e15; a greater one (or none) is taken as 0.
struct ExactAngle {
    DoubleDouble cosine_squared;
    double tangent = 0; ///< >= 0
};
[[nodiscard]] ExactAngle exact_angle(double angle_rad);

/// (a.x^2 + a.y^2 + a.z^2) * f, rounded twice only.
[[nodiscard]] DoubleDouble scaled_length_squared(const double (&a)[3], DoubleDouble f);

} // namespace fraja::kernel
