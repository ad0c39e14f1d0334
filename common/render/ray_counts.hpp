// RayCounts: the work that a picture takes.
#pragma once

#include <cstdint>

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

} // namespace fraja
