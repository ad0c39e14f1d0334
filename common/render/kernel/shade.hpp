// The light that surfaces send back, for wide hits with one material. FORMAT.md, section 6.
#pragma once

#include "common/render/kernel/tables.hpp"
#include "common/render/kernel/wide.hpp"

namespace fraja::kernel {
namespace {

FRAJA_WIDE Wide whole_power(Wide base, std::uint32_t exponent) {
    Wide result = all_lanes(1.0);
    for (; exponent > 0; exponent >>= 1, base *= base)
        if (exponent & 1u)
            result *= base;
    return result;
}

/// max(0, cosine)^ns with 0^0 = 1, at most 1e100. Of a negative ns nothing at 0.
FRAJA_WIDE Wide highlight(Wide cosine, std::int32_t ns) {
    const Wide limit = all_lanes(1e100);
    if (ns >= 0)
        return lesser(whole_power(greater(cosine, Wide{}), static_cast<std::uint32_t>(ns)), limit);
    const auto exponent = static_cast<std::uint32_t>(-static_cast<std::int64_t>(ns));
    return select(cosine > 0, lesser(1.0 / whole_power(cosine, exponent), limit), Wide{});
}

/// The diffuse colour at places of the scene; `center` as in Tables.
FRAJA_WIDE Wide3 diffuse_at(const Material& m, Wide3 place, const double (&center)[3]) {
    if (m.pattern == Material::Pattern::plain)
        return all_lanes3(m.kd);
    const Wide x = place.x + center[0], y = place.y + center[1];
    Mask one{};
    switch (m.pattern) {
    case Material::Pattern::plain:
        break;
    case Material::Pattern::damier: {
        const Wide k = round_down((x - m.x) / m.step) - round_down((y - m.y) / m.step);
        one = k - 2 * truncated(k / 2) == 0;
        break;
    }
    case Material::Pattern::hamier: { // x and y exchanged, as in Raja
        const Wide k = round_down((x - m.y) / m.step) - round_down((y - m.x) / m.step);
        one = k - 3 * truncated(k / 3) == 1;
        break;
    }
    case Material::Pattern::mamier: {
        const Wide k = round_down((y - m.y) / m.step) - round_down((x - m.x) / m.step);
        one = k - 3 * truncated(k / 3) == 0;
        break;
    }
    }
    if (m.step == 0)
        one = Mask{};
    return select(one, all_lanes3(m.kd), all_lanes3(m.kd_two));
}

/// Which fields of a chequer places lie in: two whole numbers.
FRAJA_WIDE void fields_at(const Material& m, Wide3 place, const double (&center)[3], Wide& i,
                          Wide& j) {
    const bool exchanged = m.pattern == Material::Pattern::hamier;
    i = round_down((place.x + center[0] - (exchanged ? m.y : m.x)) / m.step);
    j = round_down((place.y + center[1] - (exchanged ? m.x : m.y)) / m.step);
}

struct WideRefraction {
    Mask total; ///< reflection: nothing goes on
    Wide reflectance;
    Wide3 dir; ///< not normalised
};

/// Fresnel's amplitudes for unpolarised light. `cosine` is that of normal and dir; `leaving`: the
/// ray comes from within. Where indices have no meaning (0 on both sides, n and -n), total.
FRAJA_WIDE WideRefraction refract(Wide3 dir, Wide3 normal, Wide cosine, bool leaving, Wide index_in,
                                  Wide index_out) {
    const Wide from = leaving ? index_in : index_out;
    const Wide to = leaving ? index_out : index_in;
    const Wide k = from / to;
    const Wide ci = lesser(magnitude(cosine), all_lanes(1.0));
    const Wide sine_squared = k * k * ((1 - ci) * (1 + ci));
    const Wide ct = square_root(greater((1 - sine_squared), Wide{}));
    const Wide s = (from * ci - to * ct) / (from * ci + to * ct);
    const Wide p = (from * ct - to * ci) / (from * ct + to * ci);
    const Wide reflectance = 0.5 * (s * s + p * p);
    const Wide along = (leaving ? ct : -ct) - k * cosine;
    const Wide3 refracted = k * dir + along * normal;
    // Also true where anything is no number.
    const Mask total = ~((sine_squared <= 1) & (reflectance <= 1) & (reflectance >= 0));
    return {total, select(total, all_lanes(1.0), reflectance), refracted};
}

} // namespace
} // namespace fraja::kernel
