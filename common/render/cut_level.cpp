#include "common/render/cut_level.hpp"

#include <algorithm>
#include <variant>

namespace fraja {
namespace {

double cut_component(double light, bool exact) {
    return exact ? 0.0 : (1 / light) * (1 / 765.0);
}

} // namespace

Rgb cut_level(const World& world, bool exact) {
    const Rgb &a = world.ambient_light, &b = world.background_light;
    Rgb m{std::max(a.x, b.x), std::max(a.y, b.y), std::max(a.z, b.z)};
    for (const Light& light : world.lights)
        m += std::visit([](const auto& source) { return source.light; }, light);
    return {cut_component(m.x, exact), cut_component(m.y, exact), cut_component(m.z, exact)};
}

} // namespace fraja
