// From samples to the pixels of a tile.
#pragma once

#include "common/render/render.hpp"
#include "common/render/sampling/places.hpp"

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

namespace fraja {

/// Draws one tile. A pixel's samples are added up in their order, so that its bits depend on
/// nothing beside it.
class TileSampler {
public:
    TileSampler(const CompiledScene& scene, const RenderSettings& settings, PixelRect rect,
                RenderControl& control);
    [[nodiscard]] Result<RenderedTile> draw();

private:
    /// What its samples add up to.
    struct Pixel {
        double rgb[3] = {};
        std::uint64_t samples = 0;
    };
    /// What few settings, or few pixels, need.
    struct Loss {
        double rgb[3] = {}; ///< the weight of rays not followed
        bool budget_spent = false;
    };
    struct Buffers;

    // False: error_ says why.
    [[nodiscard]] bool draw_all_alike();
    [[nodiscard]] bool add(std::uint32_t column, std::uint32_t row, std::uint64_t first,
                           std::uint64_t count);
    [[nodiscard]] bool draw_block();
    void collect(const DrawnBlock& drawn);
    void collect_losses();
    void finish();

    const CompiledScene& scene_;
    const RenderSettings settings_;
    const SamplePlaces places_;
    RenderControl& control_;
    RenderedTile result_;
    std::optional<Error> error_;
    std::vector<Pixel> pixels_; ///< of the tile
    std::vector<Loss> losses_;  ///< likewise, once there are any
    std::unique_ptr<Buffers> buffers_;
};

} // namespace fraja
