// From the values of an object's fields to entries of a scene's tables.
#pragma once

#include "common/scene/raj_classes.hpp"
#include "common/scene/raj_diagnostics.hpp"
#include "common/scene/raj_limits.hpp"
#include "common/scene/scene.hpp"

#include <array>
#include <cstdint>
#include <string_view>
#include <vector>

namespace fraja::raj {

/// A number, or a reference to what has been built. The kind says which, and of what.
struct Value {
    double number = 0;       ///< of a number, and the refractive index of a volume
    std::uint32_t index = 0; ///< of everything else, in its table of the builder
    Place place;
    Kind kind = Kind::number;
};

/// What a field was given. Lists and graphs hold their elements, a graph two for each edge.
struct FieldValue {
    bool given = false;
    Value value;
    std::vector<Value> items;
};

using FieldValues = std::array<FieldValue, fields_max>; ///< parallel to ClassSpec::fields

/// The class of an object, where that stands, and its label (or none).
struct ObjectHead {
    const ClassSpec* spec = nullptr;
    Place place;
    std::string_view label;
};

/// Checks what the grammar does not: that fields are there and of the right kind, and that what
/// they describe can be drawn. Every build function is false when it has refused.
class Builder {
public:
    /// Both must outlive this.
    Builder(const RajLimits& limits, Diagnostics& diagnostics)
        : limits_(limits), diagnostics_(diagnostics) {}

    [[nodiscard]] bool build_from_numbers(const ObjectHead& head,
                                          const std::array<Value, 3>& numbers, Value& built);
    [[nodiscard]] bool build_from_fields(const ObjectHead& head, FieldValues& fields, Value& built);

    /// The camera that `value` (of Kind::camera) stands for.
    [[nodiscard]] const Camera& camera(const Value& value) const { return cameras_[value.index]; }
    /// The scene that `value` (of Kind::scene) stands for. The last call: the tables go
    /// with it.
    [[nodiscard]] Scene take_scene(const Value& value);

private:
    class Fields;
    /// How much there is to walk below an entry, with multiplicity, and how deep it goes.
    struct Walk {
        std::uint64_t parts = 0, depth = 0;
        void add(const Walk& below);
    };
    struct SceneParts {
        std::uint32_t world = 0, camera = 0;
    };

    bool check_fields(const ObjectHead& head, const FieldValues& fields);
    bool refuse_missing(const ObjectHead& head, std::string_view field, std::string_view what);
    bool check_items(const ObjectHead& head, const FieldSpec& spec, const FieldValue& field);
    bool check_walk(Place place, const Walk& walk);
    bool check_direction(const Fields& fields, std::string_view name);

    bool add_form(const Fields& fields, Value& built);
    bool add_local_texture(const Fields& fields, Value& built);
    bool add_chequered_texture(const Fields& fields, Value& built);
    bool add_basic_textured_form(const Fields& fields, Value& built);
    bool add_composite(const Fields& fields, Value& built);
    bool add_textured_form(const Fields& fields, TexturedForm textured_form, Walk walk,
                           Value& built);
    bool add_aggregate(const Fields& fields, Value& built);
    bool add_basic_solid(const Fields& fields, Value& built);
    bool add_solid(const Fields& fields, Solid solid, Walk walk, Value& built);
    bool add_light(const Fields& fields, Value& built);
    bool add_camera(const Fields& fields, Value& built);
    bool add_world(const Fields& fields, Value& built);
    [[nodiscard]] std::vector<Priority> priorities_of(const FieldValue& graph,
                                                      const std::vector<SolidIndex>& members);
    [[nodiscard]] Volume volume_of(const FieldValue& field);

    const RajLimits& limits_;
    Diagnostics& diagnostics_;

    Scene tables_; ///< forms, textures, textured forms, solids and their names, as they come
    std::vector<Walk> textured_form_walks_, solid_walks_; // parallel to the tables
    std::vector<std::uint32_t> solid_marks_; ///< of the last Aggregate with it that had priorities
    std::uint32_t aggregate_mark_ = 0;
    // What scenes hold by value, so that labels can share it while the text is read.
    std::vector<Vec3> triples_; ///< points, vectors, RGBs
    std::vector<LocalTexture> local_textures_;
    std::vector<Light> lights_;
    std::vector<Camera> cameras_;
    std::vector<World> worlds_;
    std::vector<SceneParts> scenes_;
};

} // namespace fraja::raj
