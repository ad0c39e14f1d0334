// for_each_seed: a property tried with many seeds; the failing one is named and can be run alone.
#pragma once

#include "common/base/rng.hpp"

#include <cstdint>
#include <cstdlib>
#include <doctest/doctest.h>

namespace fraja {

/// Of so many seeds one is tried under a sanitizer, which is slow: it looks at lines, not at cases.
#ifdef FRAJA_INSTRUMENTED
inline constexpr std::uint64_t seeds_per_trial = 4;
#else
inline constexpr std::uint64_t seeds_per_trial = 1;
#endif

/// Calls `body(rng)` with seeds 1..count, or with FRAJA_SEED alone when that is set.
template <class Body>
void for_each_seed(std::uint64_t count, Body body) {
    const char* only = std::getenv("FRAJA_SEED");
    const std::uint64_t first = only ? std::strtoull(only, nullptr, 10) : 1;
    const std::uint64_t last = only ? first : (count + seeds_per_trial - 1) / seeds_per_trial;
    for (std::uint64_t seed = first; seed <= last; ++seed) {
        CAPTURE(seed); // repeat it alone with FRAJA_SEED=<seed>
        Rng rng(seed);
        body(rng);
    }
}

} // namespace fraja
