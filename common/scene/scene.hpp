// A scene as a value: flat tables that refer to each other by index.
//
// Identity is the index. Raja gives identity a meaning for forms (a ray that starts on a form
// treats that form specially) and for solids (priorities): two forms written out twice are two
// entries, a label used twice is one entry referred to twice. Formulas and meaning: tests/golden
// and FORMAT.md.
#pragma once

#include "common/geometry/forms.hpp"
#include "common/math/vec.hpp"

#include <cstddef>
#include <cstdint>
#include <string>
#include <variant>
#include <vector>

namespace fraja {

enum class FormIndex : std::uint32_t {};
enum class TextureIndex : std::uint32_t {};
enum class TexturedFormIndex : std::uint32_t {};
enum class SolidIndex : std::uint32_t {};

// ------------------------------------------------------------------------------------- textures

/// What a surface does with light at one point. Colours are already resolved (kd * color).
struct LocalTexture {
    Rgb kd{};            ///< diffuse
    Rgb krl{};           ///< local reflection: the highlight
    Rgb krg{};           ///< global reflection: the mirror
    Rgb ktg{};           ///< global transmission: the glass
    std::int32_t ns = 0; ///< sharpness of the highlight: its exponent, truncated towards zero
    friend bool operator==(const LocalTexture&, const LocalTexture&) = default;
};

struct PlainTexture {
    LocalTexture local;
    friend bool operator==(const PlainTexture&, const PlainTexture&) = default;
};

/// raja.test.DamierTexture, HamierTexture and MamierTexture: chequers in world x and y.
struct ChequeredTexture {
    enum class Pattern : std::uint8_t { damier, hamier, mamier };
    Pattern pattern = Pattern::damier;
    Rgb kd_one{}, kd_two{};
    Rgb kr{}, kt{}; ///< krl and krg; ktg
    std::int32_t ns = 0;
    double step = 1, x = 0, y = 0;
    friend bool operator==(const ChequeredTexture&, const ChequeredTexture&) = default;
};

using Texture = std::variant<PlainTexture, ChequeredTexture>;

// -------------------------------------------------------------------------------- textured forms

struct BasicTexturedForm {
    FormIndex form{};
    TextureIndex texture_in{}, texture_out{};
    friend bool operator==(const BasicTexturedForm&, const BasicTexturedForm&) = default;
};
struct Union {
    std::vector<TexturedFormIndex> members; ///< may be empty: contains nothing
    friend bool operator==(const Union&, const Union&) = default;
};
struct Intersection {
    std::vector<TexturedFormIndex> members; ///< may be empty: contains everything
    friend bool operator==(const Intersection&, const Intersection&) = default;
};
struct Complement {
    TexturedFormIndex of{};
    friend bool operator==(const Complement&, const Complement&) = default;
};

using TexturedForm = std::variant<BasicTexturedForm, Union, Intersection, Complement>;

// ------------------------------------------------------------------------------- solids, volumes

struct IsotropicVolume {
    double refractive_index = 1;
    friend bool operator==(const IsotropicVolume&, const IsotropicVolume&) = default;
};

/// A refractive index, or (allowed by Raja, used by nobody) the index of a solid at the point asked
/// for.
using Volume = std::variant<IsotropicVolume, SolidIndex>;

struct BasicSolid {
    TexturedFormIndex textured_form{};
    Volume volume;
    friend bool operator==(const BasicSolid&, const BasicSolid&) = default;
};

/// `above` displaces `below` where both are. Not transitive.
struct Priority {
    SolidIndex above{}, below{};
    friend bool operator==(const Priority&, const Priority&) = default;
};

struct Aggregate {
    std::vector<SolidIndex> members;
    std::vector<Priority> priorities;
    friend bool operator==(const Aggregate&, const Aggregate&) = default;
};

using Solid = std::variant<BasicSolid, Aggregate>;

/// Where a solid stands in its file, for messages about it.
struct SolidName {
    std::string label;      ///< with its '@'; empty when it has none
    std::uint32_t line = 0; ///< from 1; 0 when the scene came from no file
};

// ------------------------------------------------------------------------------- lights, cameras

struct PointLight {
    Vec3 origin{};
    Rgb light{}; ///< no attenuation with distance
    friend bool operator==(const PointLight&, const PointLight&) = default;
};
struct DirectionalLight {
    Vec3 direction{}; ///< the way the light travels; its length has no meaning
    Rgb light{};
    friend bool operator==(const DirectionalLight&, const DirectionalLight&) = default;
};
using Light = std::variant<PointLight, DirectionalLight>;

/// z is up. Rays start on the screen, not at the eye.
struct HorizontalCamera {
    Vec3 origin{}, direction{};
    double focal = 0, screen_width = 0, screen_height = 0;
    friend bool operator==(const HorizontalCamera&, const HorizontalCamera&) = default;
};
/// Two parallel eyes, `step` apart; the left one draws the left half of the picture.
struct StereoCamera {
    HorizontalCamera eye;
    double step = 0;
    friend bool operator==(const StereoCamera&, const StereoCamera&) = default;
};
using Camera = std::variant<HorizontalCamera, StereoCamera>;

// ------------------------------------------------------------------------------------- the scene

struct World {
    SolidIndex solid{};
    std::vector<Light> lights; ///< in the file's order, which the sums of shading follow
    Rgb ambient_light{}, background_light{};
    Volume ambient_volume;
    friend bool operator==(const World&, const World&) = default;
};

/// Never changes once read; shared between threads as std::shared_ptr<const Scene>.
/// Every index is within its table and the references have no cycle: the reader sees to it.
struct Scene {
    std::vector<Form> forms;
    std::vector<Texture> textures;
    std::vector<TexturedForm> textured_forms;
    std::vector<Solid> solids;
    std::vector<SolidName> solid_names; ///< parallel to `solids`; not part of equality
    World world;
    Camera camera;

    friend bool operator==(const Scene& a, const Scene& b) {
        return a.forms == b.forms && a.textures == b.textures &&
               a.textured_forms == b.textured_forms && a.solids == b.solids && a.world == b.world &&
               a.camera == b.camera;
    }
};

template <class Index>
[[nodiscard]] constexpr std::size_t as_size(Index index) {
    return static_cast<std::size_t>(index);
}

} // namespace fraja
