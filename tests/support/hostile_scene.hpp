// Scenes from a seed whose numbers are absurd.
#pragma once

#include "common/base/rng.hpp"
#include "common/scene/scene.hpp"
#include "tests/support/scene_builder.hpp"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace fraja {
namespace detail {

/// From 1e-320 to 1e308, 0, and quite often something ordinary.
inline double any_magnitude(Rng& rng) {
    switch (rng.below(5)) {
    case 0:
        return 0;
    case 1:
        return std::pow(10.0, rng.between(-320, 308.2));
    case 2:
        return 1e154; // its square is nearly infinite
    default:
        return rng.unit();
    }
}
inline double any_number(Rng& rng) {
    return rng.below(2) ? any_magnitude(rng) : -any_magnitude(rng);
}
inline Vec3 any_vector(Rng& rng) {
    const double x = any_number(rng), y = any_number(rng);
    return {x, y, any_number(rng)};
}
inline Rgb any_colour(Rng& rng) {
    const double x = any_magnitude(rng), y = any_magnitude(rng);
    return {x, y, any_magnitude(rng)};
}

inline Form any_form(Rng& rng) {
    const Vec3 origin = any_vector(rng), direction = any_vector(rng);
    switch (rng.below(4)) {
    case 0:
        return Sphere{origin, any_number(rng)};
    case 1:
        return Plane{origin, direction};
    case 2:
        return Cylinder{origin, direction, any_number(rng)};
    default:
        return Cone{origin, direction, any_number(rng)};
    }
}

inline Texture any_texture(Rng& rng) {
    const auto ns =
        static_cast<std::int32_t>(static_cast<std::uint32_t>(rng.next() >> rng.below(64)));
    if (rng.below(2))
        return PlainTexture{{.kd = any_colour(rng),
                             .krl = any_colour(rng),
                             .krg = any_colour(rng),
                             .ktg = any_colour(rng),
                             .ns = ns}};
    return ChequeredTexture{.pattern = static_cast<ChequeredTexture::Pattern>(rng.below(3)),
                            .kd_one = any_colour(rng),
                            .kd_two = any_colour(rng),
                            .kr = any_colour(rng),
                            .kt = any_colour(rng),
                            .ns = ns,
                            .step = any_number(rng),
                            .x = any_number(rng),
                            .y = any_number(rng)};
}

} // namespace detail

/// Legal, but of numbers that no one would write; all pairs of solids have a priority.
inline Scene hostile_scene(Rng& rng) {
    SceneBuilder b;
    std::vector<TexturedFormIndex> forms;
    for (std::size_t i = 0; i < 6; ++i) {
        b.scene.textures.push_back(detail::any_texture(rng));
        forms.push_back(b.textured(detail::any_form(rng), static_cast<TextureIndex>(i)));
    }
    forms.push_back(b.textured(Complement{forms[0]}));
    forms.push_back(b.textured(Union{{forms[1], forms[2], forms[6]}}));
    forms.push_back(b.textured(Intersection{{forms[3], forms[4], forms[7]}}));
    std::vector<SolidIndex> members;
    std::vector<Priority> priorities;
    for (const TexturedFormIndex form : forms) {
        const auto member = b.solid(form, IsotropicVolume{detail::any_number(rng)});
        for (const SolidIndex other : members)
            priorities.push_back({other, member});
        members.push_back(member);
    }
    b.aggregate(members, priorities);
    for (int i = 0; i < 2; ++i) {
        const Vec3 place = detail::any_vector(rng);
        if (rng.below(2))
            b.scene.world.lights.push_back(PointLight{place, detail::any_colour(rng)});
        else
            b.scene.world.lights.push_back(DirectionalLight{place, detail::any_colour(rng)});
    }
    b.scene.world.ambient_light = detail::any_colour(rng);
    b.scene.world.background_light = detail::any_colour(rng);
    b.scene.camera = StereoCamera{{.origin = detail::any_vector(rng),
                                   .direction = detail::any_vector(rng),
                                   .focal = detail::any_number(rng),
                                   .screen_width = detail::any_number(rng),
                                   .screen_height = detail::any_number(rng)},
                                  detail::any_number(rng)};
    return b.scene;
}

} // namespace fraja
