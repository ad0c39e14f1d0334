// What a .raj text may ask of us, in one place.
#pragma once

#include <cstdint>

namespace fraja {

/// More than this is refused with limit_exceeded and the limit's name. The defaults are far above
/// any scene seen and keep memory within a few times the text and every walk within minutes.
/// None may exceed 2^32 - 1 (asserted).
struct RajLimits {
    std::uint64_t bytes = std::uint64_t{1} << 30; ///< of the text
    std::uint64_t token_bytes = 65'536;           ///< of one name, label or number
    std::uint64_t list_items = 16'000'000;        ///< elements of one list, edges of one graph
    std::uint64_t labels = 16'000'000;            ///< different ones
    std::uint64_t solids = 16'000'000;            ///< objects that are solids
    /// Objects within objects, counted through labels as well: what reads, compiles and traces a
    /// scene may recurse this deep.
    std::uint64_t nesting = 200;
    /// Solids and textured forms met when a solid is walked and no label is remembered. Labels make
    /// a graph of few entries with very many ways through it: `Union [@a, @a]` sixty times over has
    /// 2^60.
    std::uint64_t expanded_parts = 64'000'000;
};

} // namespace fraja
