// How much of the light a smooth surface reflects, and where the rest goes. FORMAT.md, 6.2.
#pragma once

#include "common/math/vec.hpp"

#include <optional>

namespace fraja::reference {

/// A ray at a surface between two volumes.
struct Crossing {
    Vec3 dir{};    ///< unit
    Vec3 normal{}; ///< outwards
    double index_in = 1, index_out = 1;
};

struct Refraction {
    double reflectance = 0; ///< of unpolarised light, in [0, 1]; the rest is refracted
    Vec3 dir{};             ///< not normalised
};

/// Nothing on total reflection.
///
/// Where Raja's formula is 0/0, light that meets the surface at a right angle, this is its limit:
/// R = ((n_in - n_out) / (n_in + n_out))^2 and straight on. Indices that have no limit either (0 on
/// both sides, or n and -n) reflect totally.
[[nodiscard]] std::optional<Refraction> refract(const Crossing& crossing);

} // namespace fraja::reference
