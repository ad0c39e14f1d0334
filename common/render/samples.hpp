// What a kernel is asked for: the light at places of a picture's screen.
#pragma once

#include "common/math/vec.hpp"
#include "common/render/ray_counts.hpp"
#include "common/render/sample_limits.hpp"

#include <atomic>
#include <cstdint>
#include <span>

namespace fraja {

/// Shared between a render thread and its owner while it draws.
struct RenderControl {
    std::atomic<bool> stop = false; ///< set by the owner: give up within a few rays
    std::atomic<std::uint64_t> rays =
        0; ///< kept by the renderer, at least once a pixel: it is alive
};

/// Places on the screen, 1 to block_samples_max, and room for what is seen there. A sample's bits
/// depend on its place alone; neighbours are drawn faster together.
struct SampleBlock {
    std::span<const double> x, y;   ///< from the top left, 0 to 1, or somewhat beside
    std::span<double> rgb;          ///< radiance, scene-linear: three to a sample
    std::span<double> lost;         ///< likewise: the weight of rays not followed. May be empty
    std::span<double> cut;          ///< likewise: the light that those below the cut level may
                                    ///< have been, at most
    std::span<std::uint64_t> paths; ///< what it met, as a number. May be empty
    std::span<std::uint32_t> rays;  ///< that were traced for it, without shadow rays
};

/// What a camera ray meets first.
struct FirstHit {
    Vec3 place{}, normal{};   ///< world space; unit, out of the solid
    std::uint32_t object = 0; ///< the number of the solid in Scene::solids, from 1; 0: nothing
};

/// Places on the screen, as in SampleBlock, and room for what stands there.
struct FirstHitBlock {
    std::span<const double> x, y;
    std::span<FirstHit> hits;
};

struct DrawnBlock {
    RayCounts rays;
    bool skipped = false;      ///< nothing was searched for: background, or one plane
    bool budget_spent = false; ///< a sample has more than rays_per_sample_max rays
};

} // namespace fraja
