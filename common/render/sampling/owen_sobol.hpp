// Points of the unit square that are spread evenly however many there are, and irregularly.
#pragma once

#include <cstdint>

namespace fraja {

struct SquarePoint {
    double x, y; ///< above 0, below 1
};

/// Sobol's sequence in two dimensions, scrambled after Owen with a hash: each number of a power of
/// two, from a multiple of it on, has one point in each equal part of the square that many parts
/// can be cut into by halving. Another `seed`, another scrambling.
///
/// B. Burley, "Practical Hash-based Owen Scrambling" (2020); the hash is that of N. Vegdahl,
/// "Building a Better LK Hash" (2021), after S. Laine and T. Karras (2011).
class OwenSobol {
public:
    explicit OwenSobol(std::uint32_t seed);
    [[nodiscard]] SquarePoint operator()(std::uint32_t index) const;

private:
    std::uint32_t seed_x_, seed_y_;
};

/// Mixes the bits of a key, say a pixel's place.
[[nodiscard]] std::uint32_t mixed(std::uint64_t key);

} // namespace fraja
