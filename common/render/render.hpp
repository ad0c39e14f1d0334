// What the programs call: compile a scene once, render its tiles.
#pragma once

#include "common/base/pixel_rect.hpp"
#include "common/base/result.hpp"
#include "common/image/tile.hpp"
#include "common/render/samples.hpp"
#include "common/scene/scene.hpp"

#include <cstdint>
#include <memory>
#include <variant>
#include <vector>

namespace fraja {

enum class Kernel : std::uint8_t {
    reference, ///< Raja's own arithmetic, byte for byte
    fast,      ///< the same picture but for rounding; what users get
};

/// How the samples around a pixel's centre are weighted: by how many there are.
enum class Filter : std::uint8_t {
    box,  ///< all over the pixel alike
    tent, ///< to twice its width, ever fewer
};

/// How a picture is drawn; with the scene and a pixel's place it decides that pixel's bits, alone.
struct RenderSettings {
    Extent size{256, 192};   ///< of the whole picture, also where only a part is drawn
    std::uint32_t depth = 5; ///< Raja's -d; 0 draws black
    std::uint32_t aa = 0;    ///< Raja's -a: n x n regular samples; 0: one at the pixel's centre
    std::uint32_t spp = 0;   ///< low-discrepancy samples per pixel, in place of Raja's; 0: off
    std::uint32_t first_sample = 0; ///< of the sequence that these are taken from
    std::uint32_t seed = 0;         ///< of that sequence: others' samples are independent
    bool pass = false; ///< of many: fill Tile::variance and cut, too; spp is 4 at least
    /// Low-discrepancy samples until a pixel's error is thought to be at most so many levels of
    /// 8-bit pictures (levels_per_unit); 0: off. The cut level is coupled to it.
    double error = 0;
    std::uint32_t max_samples = 1024; ///< per pixel, then; at least 4
    Filter filter = Filter::box;      ///< of low-discrepancy samples
    bool exact = false;               ///< Raja's -e: no cut-off of faint rays
    bool truncation = false;          ///< fill RenderedTile::truncated, too
    bool layers = false;              ///< fill Tile::layers, too
    friend bool operator==(const RenderSettings&, const RenderSettings&) = default;
    [[nodiscard]] bool adaptive() const { return error > 0; }
    [[nodiscard]] bool low_discrepancy() const { return spp > 0 || adaptive(); }
    /// Each pixel comes with its samples and its error: where there are 4 to judge by.
    [[nodiscard]] bool estimates() const { return adaptive() || (spp >= 4 && !pass); }
    /// Of all pixels alike, where it is not adaptive.
    [[nodiscard]] std::uint64_t samples_per_pixel() const {
        return spp > 0 ? spp : aa > 0 ? std::uint64_t{aa} * aa : 1;
    }
};

struct RenderedTile {
    Tile tile; ///< with its pixels' samples and errors, if settings.estimates()
    RayCounts rays = {};
    /// Of each pixel, if settings.truncation asks for it, the weight (of the colour that has the
    /// most) of the rays that were not followed: below the cut level, out of depth, beyond the
    /// budget. Light of 1 from everywhere is missing so much at most. Of the fast kernel alone.
    std::vector<float> truncated = {};
};

/// A scene made ready for rendering. Immutable; shared by all render threads.
class CompiledScene {
public:
    explicit CompiledScene(const Scene& scene) : camera_(scene.camera) {}
    virtual ~CompiledScene() = default;
    /// The screen's left and right half are pictures of their own, as of a stereo camera.
    [[nodiscard]] bool two_pictures() const {
        return std::holds_alternative<StereoCamera>(camera_);
    }
    [[nodiscard]] const Camera& camera() const { return camera_; }
    /// Fills the block. Errors as of render_tile.
    [[nodiscard]] virtual Result<DrawnBlock> draw_samples(const RenderSettings& settings,
                                                          const SampleBlock& block,
                                                          RenderControl& control) const = 0;
    /// Likewise, without any light.
    [[nodiscard]] virtual Result<RayCounts> find_first_hits(const FirstHitBlock& block,
                                                            RenderControl& control) const = 0;
    /// Draws `rect`, which must lie inside settings.size and not be empty (asserted).
    /// Every float is finite and not negative, whatever numbers the scene holds.
    /// Errors: unresolved_overlap, naming both solids; cancelled, when control.stop was set;
    /// limit_exceeded, when a path of more than a million bounces goes on adding light.
    [[nodiscard]] Result<RenderedTile> render_tile(const RenderSettings& settings, PixelRect rect,
                                                   RenderControl& control) const;

private:
    Camera camera_;
};

/// Never fails: what can be wrong with a scene, its reader has found.
[[nodiscard]] std::shared_ptr<const CompiledScene> compile_scene(std::shared_ptr<const Scene> scene,
                                                                 Kernel kernel);

} // namespace fraja
