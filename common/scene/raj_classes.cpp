#include "common/scene/raj_classes.hpp"

#include "common/base/text.hpp"

#include <algorithm>
#include <array>
#include <vector>

namespace fraja::raj {
namespace {

constexpr bool optional_field = false, required_field = true;
constexpr KindSet any_volume = KindSet(Kind::volume) | Kind::solid;
constexpr KindSet grey_or_rgb = KindSet(Kind::number) | Kind::rgb;

constexpr FieldSpec scene_fields[] = {{"world", Kind::world}, {"camera", Kind::camera}};
constexpr FieldSpec world_fields[] = {
    {"solid", Kind::solid},
    {"lights", Kind::list, optional_field, Kind::light},
    {"ambiantLight", Kind::rgb, optional_field},
    {"backgroundLight", Kind::rgb, optional_field},
    {"ambiantVolume", any_volume, optional_field},
};
constexpr FieldSpec horizontal_camera_fields[] = {
    {"origin", Kind::point},
    {"direction", Kind::vector},
    {"focal", Kind::number},
    {"screenWidth", Kind::number},
    {"screenHeight", Kind::number},
    {"pixelWidth", KindSet::all(), optional_field},
    {"pixelHeight", KindSet::all(), optional_field},
};
constexpr FieldSpec stereo_camera_fields[] = {
    {"origin", Kind::point},
    {"direction", Kind::vector},
    {"focal", Kind::number},
    {"screenWidth", Kind::number},
    {"screenHeight", Kind::number},
    {"step", Kind::number},
    {"cross", KindSet::all(), optional_field},
    {"pixelwidth", KindSet::all(), optional_field},
    {"pixelheight", KindSet::all(), optional_field},
};
constexpr FieldSpec point_light_fields[] = {{"origin", Kind::point}, {"light", Kind::rgb}};
constexpr FieldSpec directional_light_fields[] = {{"direction", Kind::vector},
                                                  {"light", Kind::rgb}};
constexpr FieldSpec aggregate_fields[] = {
    {"solids", Kind::list, required_field, Kind::solid},
    {"priorities", Kind::graph, required_field, Kind::solid},
};
constexpr FieldSpec basic_solid_fields[] = {{"texturedForm", Kind::textured_form},
                                            {"volume", any_volume, optional_field}};
// `texture` hides the other two, whatever they are: the builder looks closer.
constexpr FieldSpec basic_textured_form_fields[] = {{"form", Kind::form},
                                                    {"texture", Kind::texture, optional_field},
                                                    {"textureIn", KindSet::all(), optional_field},
                                                    {"textureOut", KindSet::all(), optional_field}};
constexpr FieldSpec composite_fields[] = {
    {"texturedForms", Kind::list, required_field, Kind::textured_form}};
constexpr FieldSpec complement_fields[] = {{"texturedForm", Kind::textured_form}};
constexpr FieldSpec sphere_fields[] = {{"center", Kind::point}, {"radius", Kind::number}};
constexpr FieldSpec plane_fields[] = {{"origin", Kind::point}, {"normal", Kind::vector}};
constexpr FieldSpec cylinder_fields[] = {
    {"origin", Kind::point}, {"direction", Kind::vector}, {"radius", Kind::number}};
constexpr FieldSpec cone_fields[] = {
    {"origin", Kind::point}, {"direction", Kind::vector}, {"angle", Kind::number}};
constexpr FieldSpec plain_texture_fields[] = {{"localTexture", Kind::local_texture}};
// With `color`, the coefficients must be numbers and ktl must be there: the builder sees to it.
constexpr FieldSpec local_texture_fields[] = {
    {"kd", grey_or_rgb},  {"krl", grey_or_rgb},
    {"krg", grey_or_rgb}, {"ktl", grey_or_rgb, optional_field},
    {"ktg", grey_or_rgb}, {"ns", Kind::number},
    {"nt", Kind::number}, {"color", Kind::rgb, optional_field},
};
constexpr FieldSpec chequered_texture_fields[] = {
    {"kdUn", Kind::rgb},    {"kdDeux", Kind::rgb}, {"kr", Kind::rgb},
    {"kt", Kind::rgb},      {"ns", Kind::number},  {"nt", Kind::number},
    {"step", Kind::number}, {"x", Kind::number},   {"y", Kind::number},
};

constexpr std::span<const FieldSpec> no_fields;

/// Sorted by name.
constexpr std::array<ClassSpec, 25> classes = {{
    {"raja.Point3D", ClassId::point, Kind::point, 3, no_fields},
    {"raja.RGB", ClassId::rgb, Kind::rgb, 3, no_fields},
    {"raja.Vector3D", ClassId::vector, Kind::vector, 3, no_fields},
    {"raja.light.DirectionalLightSource", ClassId::directional_light, Kind::light, 0,
     directional_light_fields},
    {"raja.light.PointLightSource", ClassId::point_light, Kind::light, 0, point_light_fields},
    {"raja.renderer.HorizontalCamera", ClassId::horizontal_camera, Kind::camera, 0,
     horizontal_camera_fields},
    {"raja.renderer.Scene", ClassId::scene, Kind::scene, 0, scene_fields},
    {"raja.renderer.StereoCamera", ClassId::stereo_camera, Kind::camera, 0, stereo_camera_fields},
    {"raja.renderer.World", ClassId::world, Kind::world, 0, world_fields},
    {"raja.shape.Aggregate", ClassId::aggregate, Kind::solid, 0, aggregate_fields},
    {"raja.shape.BasicSolid", ClassId::basic_solid, Kind::solid, 0, basic_solid_fields},
    {"raja.shape.BasicTexturedForm", ClassId::basic_textured_form, Kind::textured_form, 0,
     basic_textured_form_fields},
    {"raja.shape.Complement", ClassId::complement, Kind::textured_form, 0, complement_fields},
    {"raja.shape.Cone", ClassId::cone, Kind::form, 0, cone_fields},
    {"raja.shape.Cylinder", ClassId::cylinder, Kind::form, 0, cylinder_fields},
    {"raja.shape.Intersection", ClassId::intersection, Kind::textured_form, 0, composite_fields},
    {"raja.shape.IsotropicVolume", ClassId::isotropic_volume, Kind::volume, 1, no_fields},
    {"raja.shape.LocalTexture", ClassId::local_texture, Kind::local_texture, 0,
     local_texture_fields},
    {"raja.shape.PlainTexture", ClassId::plain_texture, Kind::texture, 0, plain_texture_fields},
    {"raja.shape.Plane", ClassId::plane, Kind::form, 0, plane_fields},
    {"raja.shape.Sphere", ClassId::sphere, Kind::form, 0, sphere_fields},
    {"raja.shape.Union", ClassId::union_, Kind::textured_form, 0, composite_fields},
    {"raja.test.DamierTexture", ClassId::damier_texture, Kind::texture, 0,
     chequered_texture_fields},
    {"raja.test.HamierTexture", ClassId::hamier_texture, Kind::texture, 0,
     chequered_texture_fields},
    {"raja.test.MamierTexture", ClassId::mamier_texture, Kind::texture, 0,
     chequered_texture_fields},
}};
static_assert(std::ranges::is_sorted(classes, {}, &ClassSpec::name));
static_assert(std::ranges::all_of(classes,
                                  [](const auto& c) { return c.fields.size() <= fields_max; }));

std::string_view bare(std::string_view class_name) {
    return class_name.substr(class_name.rfind('.') + 1); // npos + 1 is 0
}

} // namespace

std::string_view name_of(Kind kind) {
    switch (kind) {
    case Kind::number:
        return "a number";
    case Kind::point:
        return "a raja.Point3D";
    case Kind::vector:
        return "a raja.Vector3D";
    case Kind::rgb:
        return "a raja.RGB";
    case Kind::local_texture:
        return "a raja.shape.LocalTexture";
    case Kind::texture:
        return "a texture";
    case Kind::form:
        return "a form";
    case Kind::textured_form:
        return "a textured form";
    case Kind::volume:
        return "a volume";
    case Kind::solid:
        return "a solid";
    case Kind::light:
        return "a light";
    case Kind::camera:
        return "a camera";
    case Kind::world:
        return "a raja.renderer.World";
    case Kind::scene:
        return "a raja.renderer.Scene";
    case Kind::list:
        return "a list [ ]";
    case Kind::graph:
        return "a graph [[ ]]";
    }
    return "a value";
}

std::string names_of(KindSet kinds) {
    std::string names;
    for (unsigned i = 0; i <= static_cast<unsigned>(Kind::graph); ++i)
        if (const auto kind = static_cast<Kind>(i); kinds.has(kind))
            names += (names.empty() ? "" : " or ") + std::string(name_of(kind));
    return names;
}

const ClassSpec* find_class(std::string_view name) {
    const auto found = std::ranges::lower_bound(classes, name, {}, &ClassSpec::name);
    return found != classes.end() && found->name == name ? &*found : nullptr;
}

std::optional<std::string_view> nearest_class(std::string_view name) {
    std::array<std::string_view, classes.size()> bare_names;
    std::ranges::transform(classes, bare_names.begin(), [](const auto& c) { return bare(c.name); });
    const auto found = nearest_name(bare(name), bare_names);
    if (!found)
        return std::nullopt;
    return classes[static_cast<std::size_t>(std::ranges::find(bare_names, *found) -
                                            bare_names.begin())]
        .name;
}

std::optional<std::string_view> nearest_field(const ClassSpec& spec, std::string_view name) {
    std::vector<std::string_view> names;
    for (const FieldSpec& field : spec.fields)
        names.push_back(field.name);
    return nearest_name(name, names);
}

} // namespace fraja::raj
