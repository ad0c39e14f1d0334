// Ways of sampling that others use, to be measured beside ours.
#pragma once

#include "common/render/render.hpp"

#include <cstdint>
#include <string>

namespace fraja {

/// Without trailing zeros.
[[nodiscard]] std::string text_of(double value);

/// A place in each cell of a grid of n x n, where a hash says.
struct JitteredSampler {
    std::uint32_t n;
    [[nodiscard]] RenderedTile draw(const CompiledScene& scene, const RenderSettings& settings,
                                    PixelRect rect, RenderControl& control) const;
};

/// POV-Ray's method 1: a sample in each pixel's middle; where that differs from the one to the left
/// or above by more than a threshold (sum over the colours), n x n more in both, jittered.
struct ContrastSampler {
    std::uint32_t n;
    double threshold;
    [[nodiscard]] RenderedTile draw(const CompiledScene& scene, const RenderSettings& settings,
                                    PixelRect rect, RenderControl& control) const;
};

/// POV-Ray's method 2: samples at each pixel's corners; where two differ by more than a threshold
/// the pixel is cut into four, `depth` times at most. A part counts as the mean of its corners.
struct SubdividingSampler {
    std::uint32_t depth;
    double threshold;
    [[nodiscard]] RenderedTile draw(const CompiledScene& scene, const RenderSettings& settings,
                                    PixelRect rect, RenderControl& control) const;
};

} // namespace fraja
