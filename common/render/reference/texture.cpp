#include "common/render/reference/texture.hpp"

#include <cmath>

namespace fraja::reference {
namespace {

/// Whether the field that (x, y) is in shows the first colour. std::fmod has Raja's remainder: the
/// sign is the dividend's.
bool shows_first(const ChequeredTexture& t, double x, double y) {
    switch (t.pattern) {
    case ChequeredTexture::Pattern::damier:
        return std::fmod(std::floor((x - t.x) / t.step) - std::floor((y - t.y) / t.step), 2) == 0;
    case ChequeredTexture::Pattern::hamier: // x and y exchanged, as in Raja
        return std::fmod(std::floor((x - t.y) / t.step) - std::floor((y - t.x) / t.step), 3) == 1;
    case ChequeredTexture::Pattern::mamier:
        return std::fmod(std::floor((y - t.y) / t.step) - std::floor((x - t.x) / t.step), 3) == 0;
    }
    return false;
}

} // namespace

LocalTexture texture_at(const Texture& texture, const Vec3& p) {
    if (const auto* plain = std::get_if<PlainTexture>(&texture))
        return plain->local;
    const auto& t = std::get<ChequeredTexture>(texture);
    const bool first = t.step != 0 && shows_first(t, p.x, p.y);
    return {.kd = first ? t.kd_one : t.kd_two, .krl = t.kr, .krg = t.kr, .ktg = t.kt, .ns = t.ns};
}

} // namespace fraja::reference
