// SceneBuilder: small scenes as values, also such as the reader would refuse.
#pragma once

#include "common/scene/scene.hpp"

#include <string>
#include <utility>
#include <vector>

namespace fraja {

/// Starts with one white light from everywhere (ambient 1), a black background, and a camera at
/// (-5, 0, 0) that looks along x at a screen of 1 x 1, 1 away. The last solid added is the world's.
class SceneBuilder {
public:
    SceneBuilder() {
        scene.world.ambient_light = {1, 1, 1};
        scene.camera = HorizontalCamera{.origin = {-5, 0, 0},
                                        .direction = {1, 0, 0},
                                        .focal = 1,
                                        .screen_width = 1,
                                        .screen_height = 1};
    }

    TextureIndex texture(const LocalTexture& local) {
        return add(scene.textures, PlainTexture{local});
    }
    TexturedFormIndex textured(const Form& form, TextureIndex texture_index) {
        const FormIndex index = add_as<FormIndex>(scene.forms, form);
        return textured(BasicTexturedForm{index, texture_index, texture_index});
    }
    TexturedFormIndex textured(TexturedForm form) {
        return add_as<TexturedFormIndex>(scene.textured_forms, std::move(form));
    }
    SolidIndex solid(TexturedFormIndex form, Volume volume = {}, std::string label = "") {
        return name(BasicSolid{form, volume}, std::move(label));
    }
    SolidIndex solid(const Form& form, const LocalTexture& local, Volume volume = {},
                     std::string label = "") {
        return solid(textured(form, texture(local)), volume, std::move(label));
    }
    SolidIndex aggregate(std::vector<SolidIndex> members, std::vector<Priority> priorities = {}) {
        return name(Aggregate{std::move(members), std::move(priorities)}, "");
    }

    Scene scene;

private:
    template <class Index, class Table, class Value>
    static Index add_as(Table& table, Value value) {
        table.push_back(std::move(value));
        return static_cast<Index>(table.size() - 1);
    }
    TextureIndex add(std::vector<Texture>& table, const Texture& value) {
        return add_as<TextureIndex>(table, value);
    }
    SolidIndex name(Solid value, std::string label) {
        scene.solid_names.push_back({std::move(label), 0});
        scene.world.solid = add_as<SolidIndex>(scene.solids, std::move(value));
        return scene.world.solid;
    }
};

inline LocalTexture matte(double kd) {
    return {.kd = {kd, kd, kd}, .krl = {}, .krg = {}, .ktg = {}, .ns = 0};
}
inline LocalTexture glass(double ktg = 1) {
    return {.kd = {}, .krl = {}, .krg = {}, .ktg = {ktg, ktg, ktg}, .ns = 0};
}
inline LocalTexture mirror(double krg = 1) {
    return {.kd = {}, .krl = {}, .krg = {krg, krg, krg}, .ktg = {}, .ns = 0};
}

} // namespace fraja
