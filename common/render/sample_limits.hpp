// Limits on samples that the kernels and those who ask them share.
#pragma once

#include <cstdint>

namespace fraja {

/// Samples that are drawn together, at most.
inline constexpr std::uint32_t block_samples_max = 1024;

/// Rays that one sample may cost: with `exact`, glass and a great depth it would never end. What is
/// left of it then stays black.
inline constexpr std::uint32_t rays_per_sample_max = std::uint32_t{1} << 20;

} // namespace fraja
