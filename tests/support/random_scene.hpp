// Scenes from a seed: legal, drawable, and rich in what a scene can hold.
#pragma once

#include "common/base/rng.hpp"
#include "common/scene/canonical_order.hpp"
#include "common/scene/scene.hpp"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace fraja {

struct RandomSceneOptions {
    std::size_t members_max = 5;   ///< of an Aggregate, of a Union, of an Intersection
    std::size_t csg_depth_max = 3; ///< 1: bare forms only
    std::size_t aggregate_depth_max = 2;
    bool stereo = true;        ///< allow the stereo camera
    bool solid_volumes = true; ///< allow a solid in the place of a refractive index
};

namespace detail {

/// No two surfaces coincide but where one textured form stands twice in the same Union or
/// Intersection, which changes nothing. All pairs of an Aggregate's members have a priority, and it
/// is transitive, so every overlap is decided.
class SceneMaker {
public:
    SceneMaker(Rng& rng, const RandomSceneOptions& options) : rng_(rng), options_(options) {}

    Scene make() {
        scene_.world.solid = aggregate(options_.aggregate_depth_max);
        for (std::size_t n = 1 + rng_.below(3); n > 0; --n)
            scene_.world.lights.push_back(light());
        scene_.world.ambient_light = rgb(0.4);
        scene_.world.background_light = rgb(1);
        if (chance(0.2))
            scene_.world.ambient_volume = IsotropicVolume{rng_.between(1, 1.5)};
        scene_.camera = camera();
        return canonical_order(std::move(scene_));
    }

private:
    bool chance(double probability) { return rng_.unit() < probability; }
    Vec3 in_box(double half_side) {
        const double x = rng_.between(-half_side, half_side);
        const double y = rng_.between(-half_side, half_side);
        return {x, y, rng_.between(-half_side, half_side)};
    }
    /// Never zero, of any length.
    Vec3 direction() {
        Vec3 d = in_box(1);
        d.z += d.z < 0 ? -0.1 : 0.1;
        return d * rng_.between(0.1, 10);
    }
    Rgb rgb(double most) {
        if (chance(0.4))
            return Rgb(rng_.between(0, most));
        const double r = rng_.between(0, most), g = rng_.between(0, most);
        return {r, g, rng_.between(0, most)};
    }
    /// Often exactly black, as in scenes that people write.
    Rgb rgb_or_black(double most) { return chance(0.5) ? Rgb{} : rgb(most); }

    // Every table: append and give the index.
    template <class Index, class T>
    static Index add(std::vector<T>& table, T entry) {
        table.push_back(std::move(entry));
        return Index{static_cast<std::uint32_t>(table.size() - 1)};
    }

    FormIndex form() {
        const Vec3 place = in_box(2);
        switch (rng_.below(4)) {
        case 0:
            return add<FormIndex>(scene_.forms, Form(Plane{place, direction()}));
        case 1:
            return add<FormIndex>(scene_.forms,
                                  Form(Cylinder{place, direction(), rng_.between(0.2, 1)}));
        case 2:
            return add<FormIndex>(scene_.forms,
                                  Form(Cone{place, direction(), rng_.between(0.1, 1.3)}));
        default:
            return add<FormIndex>(scene_.forms, Form(Sphere{place, rng_.between(0.3, 1.5)}));
        }
    }

    TextureIndex texture() {
        if (!scene_.textures.empty() && chance(0.4)) // shared
            return TextureIndex{static_cast<std::uint32_t>(rng_.below(scene_.textures.size()))};
        if (chance(0.25)) {
            ChequeredTexture t;
            t.pattern = static_cast<ChequeredTexture::Pattern>(rng_.below(3));
            t.kd_one = rgb(1), t.kd_two = rgb(1);
            t.kr = rgb_or_black(0.4), t.kt = rgb_or_black(0.8);
            t.ns = static_cast<std::int32_t>(rng_.below(60));
            t.step = rng_.between(0.2, 2) * (chance(0.2) ? -1 : 1);
            t.x = rng_.between(-1, 1), t.y = rng_.between(-1, 1);
            return add<TextureIndex>(scene_.textures, Texture(t));
        }
        LocalTexture local;
        local.kd = rgb(0.9);
        local.krl = rgb_or_black(0.7);
        local.krg = rgb_or_black(0.5);
        local.ktg = rgb_or_black(0.9);
        local.ns = static_cast<std::int32_t>(rng_.below(60));
        return add<TextureIndex>(scene_.textures, Texture(PlainTexture{local}));
    }

    TexturedFormIndex textured_form(std::size_t depth) {
        auto& table = scene_.textured_forms;
        if (depth <= 1 || chance(0.4)) {
            const FormIndex f = form();
            const TextureIndex in = texture();
            const TextureIndex out = chance(0.6) ? in : texture();
            return add<TexturedFormIndex>(table, TexturedForm(BasicTexturedForm{f, in, out}));
        }
        if (chance(0.3)) {
            const TexturedFormIndex of = textured_form(depth - 1);
            return add<TexturedFormIndex>(table, TexturedForm(Complement{of}));
        }
        std::vector<TexturedFormIndex> members;
        for (std::size_t n = rng_.below(options_.members_max + 1); n > 0; --n)
            members.push_back(textured_form(depth - 1));
        if (!members.empty() && chance(0.2))
            members.push_back(members[rng_.below(members.size())]); // shared
        return chance(0.5) ? add<TexturedFormIndex>(table, TexturedForm(Union{members}))
                           : add<TexturedFormIndex>(table, TexturedForm(Intersection{members}));
    }

    SolidIndex add_solid(Solid solid) {
        const std::string label =
            chance(0.5) ? "@s." + std::to_string(scene_.solids.size()) : std::string();
        scene_.solid_names.push_back({label, 0});
        return add<SolidIndex>(scene_.solids, std::move(solid));
    }

    SolidIndex basic_solid() {
        BasicSolid basic;
        basic.textured_form = textured_form(options_.csg_depth_max);
        if (options_.solid_volumes && last_basic_ && chance(0.05))
            basic.volume = *last_basic_;
        else if (chance(0.6))
            basic.volume = IsotropicVolume{rng_.between(1, 2)};
        return *(last_basic_ = add_solid(basic));
    }

    SolidIndex aggregate(std::size_t depth) {
        Aggregate a;
        for (std::size_t n = 1 + rng_.below(options_.members_max); n > 0; --n)
            a.members.push_back(depth > 1 && chance(0.25) ? aggregate(depth - 1) : basic_solid());
        std::vector<SolidIndex> ranks = a.members;
        for (std::size_t i = ranks.size(); i > 1; --i)
            std::swap(ranks[i - 1], ranks[rng_.below(i)]);
        for (std::size_t high = 0; high < ranks.size(); ++high)
            for (std::size_t low = high + 1; low < ranks.size(); ++low)
                a.priorities.push_back({ranks[high], ranks[low]});
        return add_solid(std::move(a));
    }

    Light light() {
        const Rgb colour = rgb(0.8);
        if (chance(0.3))
            return DirectionalLight{direction(), colour};
        return PointLight{in_box(8), colour};
    }

    Camera camera() {
        HorizontalCamera c;
        c.origin = in_box(1);
        c.origin.x -= rng_.between(3, 9);
        c.direction = {rng_.between(0.5, 2), rng_.between(-0.3, 0.3), rng_.between(-0.3, 0.3)};
        c.focal = rng_.between(0.5, 2);
        c.screen_width = rng_.between(0.5, 2);
        c.screen_height = rng_.between(0.5, 2);
        if (options_.stereo && chance(0.2))
            return StereoCamera{c, rng_.between(0.05, 0.5)};
        return c;
    }

    Rng& rng_;
    const RandomSceneOptions& options_;
    Scene scene_;
    /// What may stand for a volume: an Aggregate would have no index where none of its members is.
    std::optional<SolidIndex> last_basic_;
};

} // namespace detail

/// In canonical order. Same numbers from `rng`, same scene.
[[nodiscard]] inline Scene random_scene(Rng& rng, const RandomSceneOptions& options = {}) {
    return detail::SceneMaker(rng, options).make();
}

} // namespace fraja
