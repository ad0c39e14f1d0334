// Straight rays through overlapping solids, against exact evaluation: which solid fills the space,
// one after the other.
#pragma once

#include "common/base/rng.hpp"

#include <cstdint>
#include <string>
#include <vector>

namespace fraja::stress {

struct Walks {
    std::uint64_t rays = 0;
    std::uint64_t wrong = 0;         ///< another row of solids than the truth, or at another place
    std::uint64_t entries = 0;       ///< rays without state, outside of everything
    std::uint64_t wrong_entries = 0; ///< likewise, of rays without state into the first
    std::uint64_t changes = 0;       ///< from solid to solid, of all rays
    std::uint64_t grazing = 0;       ///< rays not counted: so near a tangent that rounding decides
};

struct SolidRegime {
    std::string name;
    Walks (*run)(Rng& rng, std::uint64_t rays);
};

[[nodiscard]] const std::vector<SolidRegime>& solid_regimes();

} // namespace fraja::stress
