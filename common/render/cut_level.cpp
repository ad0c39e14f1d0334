#include "common/render/cut_level.hpp"

#include <algorithm>
#include <variant>

namespace fraja {
namespace {

/// Of a ray that sees all the light there is, what is not seen is this much of a level at most.
constexpr double raja_cut = 1 / 765.0;
/// For each level of error that is asked for.
constexpr double cut_per_level = 2;

double cut_component(double light, const RenderSettings& settings) {
    if (settings.exact)
        return 0;
    const double cut = (1 / light) * raja_cut;
    return settings.adaptive() ? cut_per_level * settings.error * cut : cut;
}

} // namespace

Rgb all_light(const World& world) {
    const Rgb &a = world.ambient_light, &b = world.background_light;
    Rgb m{std::max(a.x, b.x), std::max(a.y, b.y), std::max(a.z, b.z)};
    for (const Light& light : world.lights)
        m += std::visit([](const auto& source) { return source.light; }, light);
    return m;
}

Rgb cut_level(const World& world, const RenderSettings& settings) {
    const Rgb m = all_light(world);
    return {cut_component(m.x, settings), cut_component(m.y, settings),
            cut_component(m.z, settings)};
}

} // namespace fraja
