#include "common/render/kernel/materials.hpp"

#include "common/render/kernel/triples.hpp"

#include <array>
#include <bit>
#include <cstddef>
#include <map>
#include <variant>

namespace fraja::kernel {
namespace {

bool black(const Rgb& c) {
    return c == Rgb{};
}

struct Make {
    Material operator()(const PlainTexture& t) const {
        Material m{};
        put(m.kd, t.local.kd), put(m.kd_two, t.local.kd);
        put(m.krl, t.local.krl), put(m.krg, t.local.krg), put(m.ktg, t.local.ktg);
        m.ns = t.local.ns;
        m.lit = !black(t.local.kd);
        return m;
    }
    Material operator()(const ChequeredTexture& t) const {
        Material m{};
        m.pattern = t.pattern == ChequeredTexture::Pattern::damier   ? Material::Pattern::damier
                    : t.pattern == ChequeredTexture::Pattern::hamier ? Material::Pattern::hamier
                                                                     : Material::Pattern::mamier;
        put(m.kd, t.kd_one), put(m.kd_two, t.kd_two);
        put(m.krl, t.kr), put(m.krg, t.kr), put(m.ktg, t.kt);
        m.ns = t.ns, m.step = t.step, m.x = t.x, m.y = t.y;
        m.lit = !black(t.kd_one) || !black(t.kd_two);
        return m;
    }
};

/// What tells materials apart: all of their members that do not follow from others.
using MaterialBits = std::array<std::uint64_t, 20>;
MaterialBits bits_of(const Material& m) {
    static_assert(sizeof(Material) == 168, "a new member counts here, too");
    MaterialBits bits{static_cast<std::uint64_t>(m.pattern),
                      static_cast<std::uint64_t>(std::int64_t{m.ns})};
    std::size_t next = 2;
    for (const double* rgb : {m.kd, m.kd_two, m.krl, m.krg, m.ktg})
        for (int c = 0; c < 3; ++c)
            bits[next++] = std::bit_cast<std::uint64_t>(rgb[c]);
    for (const double c : {m.step, m.x, m.y})
        bits[next++] = std::bit_cast<std::uint64_t>(c);
    return bits;
}

} // namespace

Materials collect_materials(const Scene& scene) {
    Materials materials;
    materials.of_texture.reserve(scene.textures.size());
    std::map<MaterialBits, std::uint32_t> known;
    for (const Texture& texture : scene.textures) {
        Material m = std::visit(Make{}, texture);
        m.shiny = !black(vec(m.krl));
        m.lit |= m.shiny;
        m.mirror = !black(vec(m.krg));
        m.glass = !black(vec(m.ktg));
        const auto [at, is_new] =
            known.try_emplace(bits_of(m), static_cast<std::uint32_t>(materials.table.size()));
        materials.of_texture.push_back(at->second);
        if (is_new)
            materials.table.push_back(m);
    }
    return materials;
}

} // namespace fraja::kernel
