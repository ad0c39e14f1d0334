// What a kernel is asked for: the light at places of a picture's screen.
#pragma once

#include "common/render/sample_limits.hpp"

#include <atomic>
#include <cstdint>
#include <span>

namespace fraja {

/// The work that a picture took: the sum of its tiles'. Rays and shaded hits do not depend on how
/// the picture is cut into tiles, but for those of the pixels beside an adaptive tile; tests do,
/// since what lies beside a tile is not tested.
struct RayCounts {
    /// Rays by kind. camera + reflected + refracted are those that pass step 1 of FORMAT.md 6.2
    /// (neither out of depth nor below the cut level). Shadow rays are asked for where light may
    /// fall; that nothing is in the way may be known without a test.
    std::uint64_t camera = 0, reflected = 0, refracted = 0, shadow = 0;
    // Of the fast kernel alone; 0 of the reference.
    std::uint64_t box_tests = 0, form_tests = 0; ///< rays tested against a box, against a surface
    std::uint64_t shaded = 0;                    ///< hits whose light was computed
    std::uint64_t skipped_pixels = 0;   ///< of background or of one plane, known without a search
    std::uint64_t truncated_pixels = 0; ///< with a sample that ran out of rays_per_sample_max
    friend bool operator==(const RayCounts&, const RayCounts&) = default;
    [[nodiscard]] std::uint64_t traced() const { return camera + reflected + refracted; }
    RayCounts& operator+=(const RayCounts& o) {
        camera += o.camera, reflected += o.reflected, refracted += o.refracted, shadow += o.shadow;
        box_tests += o.box_tests, form_tests += o.form_tests, shaded += o.shaded;
        skipped_pixels += o.skipped_pixels, truncated_pixels += o.truncated_pixels;
        return *this;
    }
};

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

struct DrawnBlock {
    RayCounts rays;
    bool skipped = false;      ///< nothing was searched for: background, or one plane
    bool budget_spent = false; ///< a sample has more than rays_per_sample_max rays
};

} // namespace fraja
