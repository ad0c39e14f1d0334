#include "common/render/reference/model.hpp"

#include <algorithm>
#include <limits>

namespace fraja::reference {
namespace {

std::vector<Primitive> prepare_primitives(const Scene& scene) {
    std::vector<Primitive> primitives;
    primitives.reserve(scene.forms.size());
    for (std::size_t i = 0; i < scene.forms.size(); ++i)
        primitives.push_back(make_primitive(static_cast<FormIndex>(i), scene.forms[i]));
    return primitives;
}

/// Counts, per textured form, the primitive forms below it; of one used twice both uses.
class LeafCounter {
public:
    explicit LeafCounter(const Scene& scene)
        : scene_(scene), counts_(scene.textured_forms.size(), unknown) {}

    std::uint64_t count(TexturedFormIndex index) {
        std::uint64_t& known = counts_[as_size(index)];
        if (known == unknown)
            known = std::visit([&](const auto& form) { return count_in(form); },
                               scene_.textured_forms[as_size(index)]);
        return known;
    }

private:
    static constexpr std::uint64_t unknown = std::numeric_limits<std::uint64_t>::max();
    static constexpr std::uint64_t count_max = std::uint64_t{1} << 40; // sums stay far below 2^64

    std::uint64_t count_in(const BasicTexturedForm&) { return 1; }
    std::uint64_t count_in(const Complement& form) { return count(form.of); }
    std::uint64_t count_in(const Union& form) { return count_all(form.members); }
    std::uint64_t count_in(const Intersection& form) { return count_all(form.members); }
    std::uint64_t count_all(const std::vector<TexturedFormIndex>& members) {
        std::uint64_t sum = 0;
        for (const TexturedFormIndex member : members)
            sum = std::min(sum + count(member), count_max);
        return sum;
    }

    const Scene& scene_;
    std::vector<std::uint64_t> counts_;
};

std::vector<PreparedTexturedForm> prepare_textured_forms(const Scene& scene) {
    struct Prepare {
        std::uint64_t restarts_max;
        PreparedTexturedForm operator()(const BasicTexturedForm& form) const { return form; }
        PreparedTexturedForm operator()(const Complement& form) const { return form; }
        PreparedTexturedForm operator()(const Union& form) const {
            return Composite{Composite::Kind::any_member, form.members, restarts_max};
        }
        PreparedTexturedForm operator()(const Intersection& form) const {
            return Composite{Composite::Kind::every_member, form.members, restarts_max};
        }
    };
    LeafCounter leaves(scene);
    std::vector<PreparedTexturedForm> prepared;
    prepared.reserve(scene.textured_forms.size());
    for (std::size_t i = 0; i < scene.textured_forms.size(); ++i) {
        const std::uint64_t count = leaves.count(static_cast<TexturedFormIndex>(i));
        prepared.push_back(std::visit(Prepare{4 * count + 8}, scene.textured_forms[i]));
    }
    return prepared;
}

std::vector<PreparedSolid> prepare_solids(const Scene& scene) {
    struct Prepare {
        PreparedSolid operator()(const BasicSolid& solid) const { return solid; }
        PreparedSolid operator()(const Aggregate& solid) const {
            return PreparedAggregate{each_once(solid.members), Priorities(solid.priorities)};
        }
    };
    std::vector<PreparedSolid> prepared;
    prepared.reserve(scene.solids.size());
    for (const Solid& solid : scene.solids)
        prepared.push_back(std::visit(Prepare{}, solid));
    return prepared;
}

} // namespace

Model::Model(std::shared_ptr<const Scene> scene_values)
    : scene(std::move(scene_values)), camera(scene->camera), primitives(prepare_primitives(*scene)),
      textured_forms(prepare_textured_forms(*scene)), solids(prepare_solids(*scene)) {}

} // namespace fraja::reference
