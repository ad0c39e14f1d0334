#include "common/render/reference/fresnel.hpp"

#include <algorithm>

namespace fraja::reference {
namespace {

/// sqrt(1 - x^2), where x may have been rounded to a little more than 1.
double other_leg(double x) {
    return std::sqrt(std::max(0.0, 1 - x * x));
}

std::optional<Refraction> at_right_angle(const Crossing& c) {
    const double ratio = (c.index_in - c.index_out) / (c.index_in + c.index_out);
    if (!std::isfinite(ratio))
        return std::nullopt;
    return Refraction{std::min(1.0, ratio * ratio), c.dir};
}

} // namespace

std::optional<Refraction> refract(const Crossing& c) {
    const double s = dot(c.normal, c.dir);
    const bool inside = s > 0;
    const double k = inside ? c.index_in / c.index_out : c.index_out / c.index_in;
    const double ci = std::abs(s);
    const double si = other_leg(ci);
    const double st = k * si;
    if (st > 1)
        return std::nullopt;

    const double ct = other_leg(st);
    const double sin_sum = st * ci + ct * si;
    const double sin_difference = st * ci - ct * si;
    const double cos_sum = ci * ct - si * st;
    const double cos_difference = ci * ct + si * st;
    const double reflectance = 0.5 * ((sin_difference * sin_difference) / (sin_sum * sin_sum)) *
                               (1 + (cos_sum * cos_sum) / (cos_difference * cos_difference));
    const double e = inside ? ct : -ct;
    const Vec3 dir = k * c.dir + (e - k * s) * c.normal;
    if (!std::isfinite(reflectance) || !is_finite(dir))
        return at_right_angle(c);
    // Negative indices, which nature does not have, can make it greater than 1.
    return Refraction{std::min(1.0, reflectance), dir};
}

} // namespace fraja::reference
