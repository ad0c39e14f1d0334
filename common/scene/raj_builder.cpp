#include "common/scene/raj_builder.hpp"

#include "common/base/assert.hpp"
#include "common/scene/canonical_order.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

namespace fraja::raj {
namespace {

/// Not zero, nor so small or large that the square of its length leaves the doubles.
bool can_be_normalized(const Vec3& v) {
    const Vec3 unit = normalized(v);
    return is_finite(unit) && length_squared(unit) > 0.5;
}

/// As Java's (int): towards zero, and the nearest int for what is beyond.
std::int32_t truncated(double number) {
    using Limits = std::numeric_limits<std::int32_t>;
    return static_cast<std::int32_t>(
        std::clamp(number, double{Limits::min()}, double{Limits::max()}));
}

std::string in_class(const ObjectHead& head, std::string_view field, std::string_view message) {
    return std::string(head.spec->name) + ": '" + std::string(field) + "' " + std::string(message);
}

} // namespace

/// An object's fields by name.
class Builder::Fields {
public:
    Fields(const Builder& builder, const ObjectHead& head, FieldValues& values)
        : builder_(builder), head_(head), values_(values) {}

    [[nodiscard]] const ObjectHead& head() const { return head_; }
    [[nodiscard]] FieldValue& operator[](std::string_view name) const {
        const auto spec = std::ranges::find(head_.spec->fields, name, &FieldSpec::name);
        FRAJA_ASSERT(spec != head_.spec->fields.end());
        return values_[static_cast<std::size_t>(spec - head_.spec->fields.begin())];
    }
    [[nodiscard]] double number(std::string_view name) const { return (*this)[name].value.number; }
    [[nodiscard]] std::uint32_t index(std::string_view name) const {
        return (*this)[name].value.index;
    }
    [[nodiscard]] Vec3 triple(std::string_view name) const {
        return builder_.triples_[index(name)];
    }
    /// Black when it was not given.
    [[nodiscard]] Rgb rgb_or_black(std::string_view name) const {
        return (*this)[name].given ? triple(name) : Rgb{};
    }
    /// An RGB, or a number that stands for its grey.
    [[nodiscard]] Rgb grey_or_rgb(std::string_view name) const {
        return (*this)[name].value.kind == Kind::number ? Rgb(number(name)) : triple(name);
    }
    template <class Index>
    [[nodiscard]] std::vector<Index> indices(std::string_view name) const {
        std::vector<Index> list;
        list.reserve((*this)[name].items.size());
        for (const Value& item : (*this)[name].items)
            list.push_back(Index{item.index});
        return list;
    }

private:
    const Builder& builder_;
    const ObjectHead& head_;
    FieldValues& values_;
};

void Builder::Walk::add(const Walk& below) {
    parts += below.parts; // at most list_items times expanded_parts: no overflow
    depth = std::max(depth, below.depth);
}

// ------------------------------------------------------------------------------------- the public

bool Builder::build_from_numbers(const ObjectHead& head, const std::array<Value, 3>& numbers,
                                 Value& built) {
    built = {.number = 0, .index = 0, .place = head.place, .kind = head.spec->kind};
    if (head.spec->kind == Kind::volume) {
        built.number = numbers[0].number;
        if (built.number <= 0)
            diagnostics_.warn(numbers[0].place, "a refractive index that is not positive means "
                                                "nothing: do not let light through");
        return true;
    }
    if (head.spec->kind == Kind::rgb)
        for (const Value& component : numbers)
            if (component.number < 0)
                return diagnostics_.refuse(component.place, "raja.RGB: a component is negative");
    built.index = static_cast<std::uint32_t>(triples_.size());
    triples_.emplace_back(numbers[0].number, numbers[1].number, numbers[2].number);
    return true;
}

bool Builder::build_from_fields(const ObjectHead& head, FieldValues& values, Value& built) {
    if (!check_fields(head, values))
        return false;
    built = {.number = 0, .index = 0, .place = head.place, .kind = head.spec->kind};
    const Fields fields(*this, head, values);
    switch (head.spec->kind) {
    case Kind::form:
        return add_form(fields, built);
    case Kind::local_texture:
        return add_local_texture(fields, built);
    case Kind::texture:
        if (head.spec->id != ClassId::plain_texture)
            return add_chequered_texture(fields, built);
        built.index = static_cast<std::uint32_t>(tables_.textures.size());
        tables_.textures.push_back(PlainTexture{local_textures_[fields.index("localTexture")]});
        return true;
    case Kind::textured_form:
        return head.spec->id == ClassId::basic_textured_form
                   ? add_basic_textured_form(fields, built)
                   : add_composite(fields, built);
    case Kind::solid:
        return head.spec->id == ClassId::aggregate ? add_aggregate(fields, built)
                                                   : add_basic_solid(fields, built);
    case Kind::light:
        return add_light(fields, built);
    case Kind::camera:
        return add_camera(fields, built);
    case Kind::world:
        return add_world(fields, built);
    case Kind::scene:
        built.index = static_cast<std::uint32_t>(scenes_.size());
        scenes_.push_back({.world = fields.index("world"), .camera = fields.index("camera")});
        return true;
    default:
        FRAJA_ASSERT(false); // the other kinds have numbers, or no class
        return false;
    }
}

Scene Builder::take_scene(const Value& value) {
    FRAJA_ASSERT(value.kind == Kind::scene);
    const SceneParts parts = scenes_[value.index];
    tables_.world = std::move(worlds_[parts.world]);
    tables_.camera = cameras_[parts.camera];
    return canonical_order(std::move(tables_));
}

// ----------------------------------------------------------------------------------------- checks

bool Builder::check_fields(const ObjectHead& head, const FieldValues& fields) {
    for (std::size_t i = 0; i < head.spec->fields.size(); ++i) {
        const FieldSpec& spec = head.spec->fields[i];
        const FieldValue& field = fields[i];
        if (!field.given) {
            if (spec.required)
                return refuse_missing(head, spec.name, names_of(spec.kinds));
        } else if (!spec.kinds.has(field.value.kind)) {
            return diagnostics_.refuse(
                field.value.place, in_class(head, spec.name, "must be ") + names_of(spec.kinds) +
                                       ", not " + std::string(name_of(field.value.kind)));
        } else if (!check_items(head, spec, field)) {
            return false;
        }
    }
    return true;
}

bool Builder::refuse_missing(const ObjectHead& head, std::string_view field,
                             std::string_view what) {
    return diagnostics_.refuse(head.place, std::string(head.spec->name) + " lacks '" +
                                               std::string(field) + "', " + std::string(what));
}

bool Builder::check_items(const ObjectHead& head, const FieldSpec& spec, const FieldValue& field) {
    if (!spec.items)
        return true;
    for (const Value& item : field.items)
        if (item.kind != *spec.items)
            return diagnostics_.refuse(item.place, std::string(head.spec->name) + ": an item of '" +
                                                       std::string(spec.name) + "' must be " +
                                                       std::string(name_of(*spec.items)) +
                                                       ", not " + std::string(name_of(item.kind)));
    return true;
}

bool Builder::check_walk(Place place, const Walk& walk) {
    if (walk.depth > limits_.nesting)
        return diagnostics_.refuse_limit(place, "nesting", limits_.nesting,
                                         "objects within one another, counted through labels");
    if (walk.parts > limits_.expanded_parts)
        return diagnostics_.refuse_limit(
            place, "expanded_parts", limits_.expanded_parts,
            "solids and textured forms, each counted as often as labels repeat it");
    return true;
}

bool Builder::check_direction(const Fields& fields, std::string_view name) {
    if (can_be_normalized(fields.triple(name)))
        return true;
    return diagnostics_.refuse(
        fields[name].value.place,
        in_class(fields.head(), name, "is zero, or too small or large to be normalised"));
}

// --------------------------------------------------------------------------------- forms, textures

bool Builder::add_form(const Fields& fields, Value& built) {
    const auto add = [&](const Form& form) {
        built.index = static_cast<std::uint32_t>(tables_.forms.size());
        tables_.forms.push_back(form);
        return true;
    };
    switch (fields.head().spec->id) {
    case ClassId::sphere:
        return add(Sphere{fields.triple("center"), fields.number("radius")});
    case ClassId::plane:
        return check_direction(fields, "normal") &&
               add(Plane{fields.triple("origin"), fields.triple("normal")});
    case ClassId::cylinder:
        return check_direction(fields, "direction") &&
               add(Cylinder{fields.triple("origin"), fields.triple("direction"),
                            fields.number("radius")});
    default: {
        const double k = std::cos(fields.number("angle"));
        if (1 - k * k == 0)
            return diagnostics_.refuse(
                fields["angle"].value.place,
                in_class(fields.head(), "angle",
                         "leaves no cone: its cosine is 1 or -1 (the angle is in radians)"));
        return check_direction(fields, "direction") &&
               add(Cone{fields.triple("origin"), fields.triple("direction"),
                        fields.number("angle")});
    }
    }
}

bool Builder::add_local_texture(const Fields& fields, Value& built) {
    const bool coloured = fields["color"].given;
    for (const std::string_view name : {"kd", "krl", "krg", "ktl", "ktg"}) {
        const FieldValue& field = fields[name];
        if (coloured && !field.given)
            return refuse_missing(fields.head(), name, "a number");
        if (coloured && field.value.kind != Kind::number)
            return diagnostics_.refuse(
                field.value.place,
                in_class(fields.head(), name, "must be a number where there is 'color'"));
        if (!field.given)
            continue;
        const Rgb resolved = coloured && name == "kd" ? field.value.number * fields.triple("color")
                                                      : fields.grey_or_rgb(name);
        if (resolved.x < 0 || resolved.y < 0 || resolved.z < 0)
            return diagnostics_.refuse(field.value.place,
                                       in_class(fields.head(), name, "must not be negative"));
        if (!is_finite(resolved))
            return diagnostics_.refuse(field.value.place,
                                       in_class(fields.head(), name, "times 'color' is infinite"));
    }
    LocalTexture texture;
    texture.kd = coloured ? fields.number("kd") * fields.triple("color") : fields.grey_or_rgb("kd");
    texture.krl = fields.grey_or_rgb("krl");
    texture.krg = fields.grey_or_rgb("krg");
    texture.ktg = fields.grey_or_rgb("ktg");
    texture.ns = truncated(fields.number("ns"));
    built.index = static_cast<std::uint32_t>(local_textures_.size());
    local_textures_.push_back(texture);
    return true;
}

bool Builder::add_chequered_texture(const Fields& fields, Value& built) {
    using Pattern = ChequeredTexture::Pattern;
    ChequeredTexture texture;
    texture.pattern = fields.head().spec->id == ClassId::damier_texture   ? Pattern::damier
                      : fields.head().spec->id == ClassId::hamier_texture ? Pattern::hamier
                                                                          : Pattern::mamier;
    texture.kd_one = fields.triple("kdUn");
    texture.kd_two = fields.triple("kdDeux");
    texture.kr = fields.triple("kr");
    texture.kt = fields.triple("kt");
    texture.ns = truncated(fields.number("ns"));
    texture.step = fields.number("step");
    texture.x = fields.number("x");
    texture.y = fields.number("y");
    built.index = static_cast<std::uint32_t>(tables_.textures.size());
    tables_.textures.push_back(texture);
    return true;
}

// ---------------------------------------------------------------------------------- textured forms

bool Builder::add_basic_textured_form(const Fields& fields, Value& built) {
    BasicTexturedForm basic{.form = FormIndex{fields.index("form")}};
    if (fields["texture"].given) { // the other two are not even looked at
        basic.texture_in = basic.texture_out = TextureIndex{fields.index("texture")};
    } else {
        for (const std::string_view name : {"textureIn", "textureOut"}) {
            const FieldValue& field = fields[name];
            if (!field.given)
                return refuse_missing(fields.head(), name,
                                      "a texture (or 'texture', for both sides)");
            if (field.value.kind != Kind::texture)
                return diagnostics_.refuse(
                    field.value.place,
                    in_class(fields.head(), name,
                             "must be a texture, not " + std::string(name_of(field.value.kind))));
        }
        basic.texture_in = TextureIndex{fields.index("textureIn")};
        basic.texture_out = TextureIndex{fields.index("textureOut")};
    }
    return add_textured_form(fields, basic, {}, built);
}

bool Builder::add_composite(const Fields& fields, Value& built) {
    Walk walk;
    if (fields.head().spec->id == ClassId::complement) {
        const std::uint32_t of = fields.index("texturedForm");
        walk.add(textured_form_walks_[of]);
        return add_textured_form(fields, Complement{TexturedFormIndex{of}}, walk, built);
    }
    auto members = fields.indices<TexturedFormIndex>("texturedForms");
    for (const TexturedFormIndex member : members)
        walk.add(textured_form_walks_[as_size(member)]);
    return fields.head().spec->id == ClassId::union_
               ? add_textured_form(fields, Union{std::move(members)}, walk, built)
               : add_textured_form(fields, Intersection{std::move(members)}, walk, built);
}

/// `walk` is that of what lies below.
bool Builder::add_textured_form(const Fields& fields, TexturedForm textured_form, Walk walk,
                                Value& built) {
    ++walk.parts, ++walk.depth;
    if (!check_walk(fields.head().place, walk))
        return false;
    built.index = static_cast<std::uint32_t>(tables_.textured_forms.size());
    tables_.textured_forms.push_back(std::move(textured_form));
    textured_form_walks_.push_back(walk);
    return true;
}

// ------------------------------------------------------------------------------------------ solids

bool Builder::add_basic_solid(const Fields& fields, Value& built) {
    const std::uint32_t textured_form = fields.index("texturedForm");
    const Volume volume = volume_of(fields["volume"]);
    Walk walk = textured_form_walks_[textured_form];
    if (const auto* solid = std::get_if<SolidIndex>(&volume))
        walk.add(solid_walks_[as_size(*solid)]);
    return add_solid(fields, BasicSolid{TexturedFormIndex{textured_form}, volume}, walk, built);
}

bool Builder::add_aggregate(const Fields& fields, Value& built) {
    Aggregate aggregate;
    aggregate.members = fields.indices<SolidIndex>("solids");
    aggregate.priorities = priorities_of(fields["priorities"], aggregate.members);
    Walk walk;
    for (const SolidIndex member : aggregate.members)
        walk.add(solid_walks_[as_size(member)]);
    return add_solid(fields, std::move(aggregate), walk, built);
}

/// `walk` is that of what lies below.
bool Builder::add_solid(const Fields& fields, Solid solid, Walk walk, Value& built) {
    const ObjectHead& head = fields.head();
    ++walk.parts, ++walk.depth;
    if (tables_.solids.size() >= limits_.solids)
        return diagnostics_.refuse_limit(head.place, "solids", limits_.solids, "solids");
    if (!check_walk(head.place, walk))
        return false;
    built.index = static_cast<std::uint32_t>(tables_.solids.size());
    tables_.solids.push_back(std::move(solid));
    tables_.solid_names.push_back({std::string(head.label), head.place.line});
    solid_walks_.push_back(walk);
    solid_marks_.push_back(0);
    return true;
}

/// An Aggregate only ever asks for priorities between its members; others are left out.
std::vector<Priority> Builder::priorities_of(const FieldValue& graph,
                                             const std::vector<SolidIndex>& members) {
    std::vector<Priority> priorities;
    if (graph.items.empty())
        return priorities;
    ++aggregate_mark_;
    for (const SolidIndex member : members)
        solid_marks_[as_size(member)] = aggregate_mark_;
    const auto is_member = [&](SolidIndex i) {
        return solid_marks_[as_size(i)] == aggregate_mark_;
    };
    priorities.reserve(graph.items.size() / 2);
    for (std::size_t i = 0; i + 1 < graph.items.size(); i += 2) {
        const Priority priority{SolidIndex{graph.items[i].index},
                                SolidIndex{graph.items[i + 1].index}};
        if (is_member(priority.above) && is_member(priority.below))
            priorities.push_back(priority);
        else
            diagnostics_.warn(graph.items[i].place,
                              "a priority without effect: not between members of this "
                              "raja.shape.Aggregate");
    }
    return priorities;
}

/// Index 1 where none was given.
Volume Builder::volume_of(const FieldValue& field) {
    if (!field.given)
        return IsotropicVolume{};
    if (field.value.kind == Kind::solid)
        return SolidIndex{field.value.index};
    return IsotropicVolume{field.value.number};
}

// --------------------------------------------------------------------------- lights, camera, world

bool Builder::add_light(const Fields& fields, Value& built) {
    built.index = static_cast<std::uint32_t>(lights_.size());
    if (fields.head().spec->id == ClassId::point_light) {
        lights_.push_back(PointLight{fields.triple("origin"), fields.triple("light")});
        return true;
    }
    lights_.push_back(DirectionalLight{fields.triple("direction"), fields.triple("light")});
    return check_direction(fields, "direction");
}

bool Builder::add_camera(const Fields& fields, Value& built) {
    const ObjectHead& head = fields.head();
    const HorizontalCamera eye{.origin = fields.triple("origin"),
                               .direction = fields.triple("direction"),
                               .focal = fields.number("focal"),
                               .screen_width = fields.number("screenWidth"),
                               .screen_height = fields.number("screenHeight")};
    if (!check_direction(fields, "direction"))
        return false;
    const bool stereo = head.spec->id == ClassId::stereo_camera;
    const Vec3 d = normalized(eye.direction);
    const Vec3 left(-d.y, d.x, 0), eyes_apart(-eye.direction.y, eye.direction.x, 0);
    if (!can_be_normalized(left) || (stereo && !can_be_normalized(eyes_apart)))
        return diagnostics_.refuse(
            fields["direction"].value.place,
            in_class(head, "direction", "is vertical: the picture has no upper side"));
    if (eye.focal == 0 && eye.screen_width == 0 && eye.screen_height == 0)
        return diagnostics_.refuse(head.place, std::string(head.spec->name) +
                                                   ": the screen is a point at the eye");
    built.index = static_cast<std::uint32_t>(cameras_.size());
    if (stereo)
        cameras_.push_back(StereoCamera{eye, fields.number("step")});
    else
        cameras_.push_back(eye);
    return true;
}

bool Builder::add_world(const Fields& fields, Value& built) {
    World world;
    world.solid = SolidIndex{fields.index("solid")};
    for (const Value& light : fields["lights"].items)
        world.lights.push_back(lights_[light.index]);
    world.ambient_light = fields.rgb_or_black("ambiantLight");
    world.background_light = fields.rgb_or_black("backgroundLight");
    world.ambient_volume = volume_of(fields["ambiantVolume"]);
    built.index = static_cast<std::uint32_t>(worlds_.size());
    worlds_.push_back(std::move(world));
    return true;
}

} // namespace fraja::raj
