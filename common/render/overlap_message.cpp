#include "common/render/overlap_message.hpp"

#include <algorithm>

namespace fraja {
namespace {

SolidName name_of(const Scene& scene, SolidIndex solid) {
    const std::size_t i = as_size(solid);
    return i < scene.solid_names.size() ? scene.solid_names[i] : SolidName{};
}

/// "@a (line 11)", "the one at line 11", "number 3".
std::string describe(const Scene& scene, SolidIndex solid) {
    const SolidName name = name_of(scene, solid);
    const std::string line = std::to_string(name.line);
    if (!name.label.empty())
        return name.line ? name.label + " (line " + line + ")" : name.label;
    return name.line ? "the one at line " + line : "number " + std::to_string(as_size(solid));
}

std::string cure(const SolidName& a, const SolidName& b) {
    if (a.label.empty() || b.label.empty() || a.label == b.label)
        return "give each a label of its own and say in priorities which is above the other";
    const std::string a_above = "'" + a.label + " >> " + b.label + "'";
    const std::string b_above = "'" + b.label + " >> " + a.label + "'";
    return "add " + a_above + " or " + b_above + " to priorities";
}

std::string missing_priority(const Scene& scene, SolidIndex a, SolidIndex b) {
    return "solids " + describe(scene, a) + " and " + describe(scene, b) +
           " overlap where a ray passes and neither has priority over the other; " +
           cure(name_of(scene, a), name_of(scene, b));
}

/// Every two are related, so some a is below some b, and this b below some c...
std::string circle(const Scene& scene, const Priorities& priorities,
                   std::span<const SolidIndex> set) {
    const SolidIndex below = set.front();
    const auto above = std::find_if(set.begin(), set.end(), [&](SolidIndex b) {
        return b != below && !priorities.above(below, b);
    });
    return "solids " + describe(scene, *above) + " and " + describe(scene, below) +
           " overlap, along with others, where a ray passes, and the priorities between them go "
           "round in a circle; one must have priority over all others";
}

} // namespace

std::string overlap_message(const Scene& scene, const Priorities& priorities,
                            std::span<const SolidIndex> set) {
    for (std::size_t i = 0; i < set.size(); ++i)
        for (std::size_t j = i + 1; j < set.size(); ++j)
            if (!priorities.above(set[i], set[j]) && !priorities.above(set[j], set[i]))
                return missing_priority(scene, set[i], set[j]);
    return circle(scene, priorities, set);
}

} // namespace fraja
