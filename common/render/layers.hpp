// Layers: what stands at the middle of each pixel of a tile.
#pragma once

#include "common/render/render.hpp"

namespace fraja {

/// Fills tile.layers (layer_names), and adds the rays that it took, one a pixel. Errors as of
/// CompiledScene::render_tile.
[[nodiscard]] Result<void> add_layers(const CompiledScene& scene, const RenderSettings& settings,
                                      RenderedTile& tile, RenderControl& control);

} // namespace fraja
