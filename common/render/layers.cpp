#include "common/render/layers.hpp"

#include "common/render/sampling/places.hpp"

#include <algorithm>
#include <limits>
#include <variant>
#include <vector>

namespace fraja {
namespace {

/// The eye that sees a place of the screen.
Vec3 eye_at(const Camera& camera, double x) {
    const auto* stereo = std::get_if<StereoCamera>(&camera);
    if (!stereo)
        return std::get<HorizontalCamera>(camera).origin;
    const Vec3& dir = stereo->eye.direction;
    const Vec3 left = normalized({-dir.y, dir.x, 0});
    const Vec3 aside = (stereo->step / 2) * (is_finite(left) ? left : Vec3{0, 1, 0});
    return stereo->eye.origin + (x < 0.5 ? aside : -aside);
}

} // namespace

Result<void> add_layers(const CompiledScene& scene, const RenderSettings& settings,
                        RenderedTile& tile, RenderControl& control) {
    const PixelRect& rect = tile.tile.rect;
    const std::size_t pixels = rect.pixel_count();
    std::vector<float>& layers = tile.tile.layers;
    layers.assign(layer_names.size() * pixels, 0);
    std::vector<double> x, y;
    std::vector<FirstHit> hits;
    for (std::size_t begin = 0; begin < pixels; begin += hits.size()) {
        const std::size_t count = std::min<std::size_t>(block_samples_max, pixels - begin);
        x.clear(), y.clear();
        hits.assign(count, {});
        for (std::size_t i = begin; i < begin + count; ++i) {
            x.push_back((static_cast<double>(rect.x + i % rect.width) + 0.5) / settings.size.width);
            y.push_back((static_cast<double>(rect.y + i / rect.width) + 0.5) /
                        settings.size.height);
        }
        const auto rays = scene.find_first_hits({x, y, hits}, control);
        if (!rays)
            return rays.error();
        tile.rays += *rays;
        for (std::size_t i = 0; i < count; ++i) {
            const FirstHit& hit = hits[i];
            const double distance = hit.object == 0
                                        ? std::numeric_limits<double>::infinity()
                                        : length(hit.place - eye_at(scene.camera(), x[i]));
            const double values[] = {distance, hit.normal.x, hit.normal.y, hit.normal.z,
                                     static_cast<double>(hit.object)};
            for (std::size_t plane = 0; plane < layer_names.size(); ++plane)
                layers[plane * pixels + begin + i] = static_cast<float>(values[plane]);
        }
    }
    return {};
}

} // namespace fraja
