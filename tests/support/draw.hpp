// Draws (a part of) a picture on a few threads, as a test needs it.
#pragma once

#include "common/image/film.hpp"
#include "common/render/render.hpp"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

namespace fraja {

struct Drawn {
    Film film;
    RayCounts rays;
    std::vector<float> truncated; ///< by pixel, row by row, where the settings ask for it
};

/// Each row is a tile; `threads` take the next row that nobody has taken. The first error, in no
/// particular order, is the result.
[[nodiscard]] inline Result<Drawn> draw(const CompiledScene& scene, const RenderSettings& settings,
                                        PixelRect region, unsigned threads = 2) {
    Drawn drawn{
        Film(settings.size, region, {.estimates = settings.estimates(), .layers = settings.layers}),
        {},
        {}};
    if (settings.truncation)
        drawn.truncated.resize(region.pixel_count());
    std::mutex mutex; // guards `drawn` and `error`
    std::optional<Error> error;
    RenderControl control;
    std::atomic<std::uint32_t> next_row = 0;
    const auto draw_rows = [&] {
        for (;;) {
            const std::uint32_t row = next_row++;
            if (row >= region.height)
                return;
            const Result<RenderedTile> tile =
                scene.render_tile(settings, {region.x, region.y + row, region.width, 1}, control);
            const std::scoped_lock lock(mutex);
            if (!tile) {
                if (!error)
                    error = tile.error();
                control.stop = true;
                return;
            }
            drawn.film.place(tile->tile);
            drawn.rays += tile->rays;
            std::ranges::copy(tile->truncated,
                              drawn.truncated.begin() + std::ptrdiff_t{row} * region.width);
        }
    };
    {
        std::vector<std::jthread> crew;
        for (unsigned i = 1; i < threads; ++i)
            crew.emplace_back(draw_rows);
        draw_rows();
    }
    if (error)
        return *error;
    return drawn;
}

/// The whole picture.
[[nodiscard]] inline Result<Drawn> draw(const CompiledScene& scene,
                                        const RenderSettings& settings) {
    return draw(scene, settings, {0, 0, settings.size.width, settings.size.height});
}

/// As that kernel draws it.
[[nodiscard]] inline Result<Drawn> draw(const Scene& scene, Kernel kernel,
                                        const RenderSettings& settings) {
    return draw(*compile_scene(std::make_shared<const Scene>(scene), kernel), settings);
}

} // namespace fraja
