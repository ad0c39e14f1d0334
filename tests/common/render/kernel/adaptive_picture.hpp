// What tests of adaptive pictures draw, and what of it they look at.
#pragma once

#include "common/image/film.hpp"
#include "common/render/render.hpp"
#include "common/scene/raj_reader.hpp"
#include "tests/support/scene_builder.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <filesystem>
#include <memory>
#include <numeric>
#include <span>
#include <string_view>
#include <utility>

namespace fraja {

/// A chequered floor to the horizon, on it a ball, a mirror and glass, under two lamps.
inline Scene edges() {
    SceneBuilder b;
    b.scene.textures.push_back(ChequeredTexture{.kd_one = {0.7, 0.6, 0.5},
                                                .kd_two = {0.1, 0.1, 0.2},
                                                .kr = {0.1, 0.1, 0.1},
                                                .kt = {},
                                                .ns = 20,
                                                .step = 1.5,
                                                .x = 0.3,
                                                .y = 0.2});
    const auto floor = b.solid(b.textured(Plane{{0, 0, -2}, {0, 0, 1}}, TextureIndex{0}));
    LocalTexture shiny = mirror(0.5);
    shiny.kd = {0.1, 0.3, 0.1};
    b.aggregate({floor, b.solid(Sphere{{4, 2, -0.5}, 1.5}, matte(0.6)),
                 b.solid(Sphere{{5, -1.5, 0}, 1.7}, shiny),
                 b.solid(Sphere{{1, 0, -1.2}, 0.7}, glass(0.9), IsotropicVolume{1.5})});
    b.scene.world.lights = {PointLight{{-4, 6, 8}, {0.5, 0.5, 0.5}},
                            DirectionalLight{{1, 1.5, -2}, {0.3, 0.3, 0.2}}};
    b.scene.world.ambient_light = {0.1, 0.1, 0.1};
    b.scene.world.background_light = {0.3, 0.5, 0.8};
    return b.scene;
}

inline std::shared_ptr<const CompiledScene> compiled(Scene scene, Kernel kernel = Kernel::fast) {
    return compile_scene(std::make_shared<const Scene>(std::move(scene)), kernel);
}

inline Scene of_file(std::string_view name) {
    auto scene = read_raj_file(std::filesystem::path(FRAJA_SOURCE_DIR) / "scenes" / name);
    REQUIRE(scene.has_value());
    return std::move(*scene);
}

/// The region, in tiles of so many pixels a side.
inline Film film_of(const CompiledScene& scene, const RenderSettings& settings, PixelRect region,
                    std::uint32_t side) {
    Film film(settings.size, region, {.estimates = true});
    RenderControl control;
    for (std::uint32_t y = 0; y < region.height; y += side)
        for (std::uint32_t x = 0; x < region.width; x += side) {
            const auto tile =
                scene.render_tile(settings,
                                  {region.x + x, region.y + y, std::min(side, region.width - x),
                                   std::min(side, region.height - y)},
                                  control);
            REQUIRE(tile.has_value());
            film.place(tile->tile);
        }
    return film;
}
inline Film film_of(const CompiledScene& scene, const RenderSettings& settings) {
    return film_of(scene, settings, {0, 0, settings.size.width, settings.size.height}, 32);
}

inline double sum(std::span<const float> values) {
    return std::accumulate(values.begin(), values.end(), 0.0);
}

} // namespace fraja
