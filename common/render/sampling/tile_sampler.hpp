// From samples to the pixels of a tile: as many for each, or as many as each needs.
#pragma once

#include "common/render/render.hpp"

namespace fraja {

/// All pixels have settings.samples_per_pixel().
[[nodiscard]] Result<RenderedTile> draw_uniform(const CompiledScene& scene,
                                                const RenderSettings& settings, PixelRect rect,
                                                RenderControl& control);

/// A pixel has 4 samples, then twice as many, and so on, until its error is thought to be at most
/// settings.error levels (estimate.hpp), or it has settings.max_samples. That depends on its
/// samples and on the first four of its neighbours', or the first in other cells of 32 x 32 pixels;
/// those beside the tile are drawn, too.
[[nodiscard]] Result<RenderedTile> draw_adaptive(const CompiledScene& scene,
                                                 const RenderSettings& settings, PixelRect rect,
                                                 RenderControl& control);

} // namespace fraja
