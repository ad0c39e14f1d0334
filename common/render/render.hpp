// What the programs call: compile a scene once, render its tiles.
#pragma once

#include "common/base/pixel_rect.hpp"
#include "common/base/result.hpp"
#include "common/image/tile.hpp"
#include "common/scene/scene.hpp"

#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

namespace fraja {

enum class Kernel : std::uint8_t {
    reference, ///< Raja's own arithmetic, byte for byte
    fast,      ///< the same picture but for rounding; what users get
};

/// How a picture is drawn; with the scene and a pixel's place it decides that pixel's bits, alone.
struct RenderSettings {
    Extent size{256, 192};   ///< of the whole picture, also where only a part is drawn
    std::uint32_t depth = 5; ///< Raja's -d; 0 draws black
    std::uint32_t aa = 0;    ///< Raja's -a: n x n regular samples; 0: one at the pixel's centre
    bool exact = false;      ///< Raja's -e: no cut-off of faint rays
    bool truncation = false; ///< fill RenderedTile::truncated, too
    friend bool operator==(const RenderSettings&, const RenderSettings&) = default;
};

/// The work that a picture took: the sum of its tiles'. Rays and shaded hits do not depend on how
/// the picture is cut into tiles; tests do, since what lies beside a tile is not tested.
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

/// Shared between a render thread and its owner while a tile is drawn.
struct RenderControl {
    std::atomic<bool> stop = false; ///< set by the owner: give up within a few rays
    std::atomic<std::uint64_t> rays =
        0; ///< kept by the renderer, at least once a pixel: it is alive
};

struct RenderedTile {
    Tile tile;
    RayCounts rays;
    /// Of each pixel, if settings.truncation asks for it, the weight (of the colour that has the
    /// most) of the rays that were not followed: below the cut level, out of depth, beyond the
    /// budget. Light of 1 from everywhere is missing so much at most. Of the fast kernel alone.
    std::vector<float> truncated;
};

/// A scene made ready for rendering. Immutable; shared by all render threads.
class CompiledScene {
public:
    virtual ~CompiledScene() = default;
    /// Draws `rect`, which must lie inside settings.size and not be empty (asserted).
    /// Every float is finite and not negative, whatever numbers the scene holds.
    /// Errors: unresolved_overlap, naming both solids; cancelled, when control.stop was set;
    /// limit_exceeded, when a path of more than a million bounces goes on adding light.
    [[nodiscard]] virtual Result<RenderedTile>
    render_tile(const RenderSettings& settings, PixelRect rect, RenderControl& control) const = 0;
};

/// Never fails: what can be wrong with a scene, its reader has found.
[[nodiscard]] std::shared_ptr<const CompiledScene> compile_scene(std::shared_ptr<const Scene> scene,
                                                                 Kernel kernel);

} // namespace fraja
