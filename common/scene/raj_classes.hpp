// The 25 classes that a .raj text can name, and the fields of each (FORMAT.md 2).
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace fraja::raj {

/// What a value is, as far as fields care.
enum class Kind : std::uint8_t {
    number,
    point,
    vector,
    rgb,
    local_texture,
    texture,
    form,
    textured_form,
    volume, ///< a refractive index; a solid will do in its place
    solid,
    light,
    camera,
    world,
    scene,
    list,
    graph,
};

/// "a number", "a raja.Point3D", "a textured form": for messages.
[[nodiscard]] std::string_view name_of(Kind kind);

class KindSet {
public:
    constexpr KindSet() = default;
    constexpr KindSet(Kind kind) : bits_(1u << static_cast<unsigned>(kind)) {}
    [[nodiscard]] static constexpr KindSet all() { return KindSet(~0u); }
    friend constexpr KindSet operator|(KindSet a, KindSet b) { return KindSet(a.bits_ | b.bits_); }
    [[nodiscard]] constexpr bool has(Kind kind) const { return bits_ & KindSet(kind).bits_; }

private:
    explicit constexpr KindSet(std::uint32_t bits) : bits_(bits) {}
    std::uint32_t bits_ = 0;
};

/// "a number or a raja.RGB".
[[nodiscard]] std::string names_of(KindSet kinds);

struct FieldSpec {
    std::string_view name;
    KindSet kinds;
    bool required = true;
    std::optional<Kind> items = {}; ///< of a list or graph: what its elements must be
};

enum class ClassId : std::uint8_t {
    point,
    vector,
    rgb,
    scene,
    world,
    horizontal_camera,
    stereo_camera,
    point_light,
    directional_light,
    aggregate,
    basic_solid,
    basic_textured_form,
    union_,
    intersection,
    complement,
    sphere,
    plane,
    cylinder,
    cone,
    isotropic_volume,
    plain_texture,
    local_texture,
    damier_texture,
    hamier_texture,
    mamier_texture,
};

struct ClassSpec {
    std::string_view name;
    ClassId id;
    Kind kind;
    std::size_t number_count = 0; ///< of a body { 1 ; 2 ; 3 }; 0: the body has named fields
    std::span<const FieldSpec> fields = {};
};

inline constexpr std::size_t fields_max = 9; ///< of any class

/// Null when there is no such class. The name is the full one.
[[nodiscard]] const ClassSpec* find_class(std::string_view name);

/// The class that was probably meant, going by the part after the last dot: raja.shape.Sphere for
/// `Sphere`, `raja.Sphere` and `raja.shape.Shpere`.
[[nodiscard]] std::optional<std::string_view> nearest_class(std::string_view name);

[[nodiscard]] std::optional<std::string_view> nearest_field(const ClassSpec& spec,
                                                            std::string_view name);

} // namespace fraja::raj
