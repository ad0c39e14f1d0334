#include "common/render/kernel/solids.hpp"

#include <algorithm>
#include <utility>
#include <variant>

namespace fraja::kernel {

std::optional<double> refractive_index(const Scene& scene, const Volume& volume) {
    const Volume* v = &volume;
    while (const auto* solid = std::get_if<SolidIndex>(v)) {
        const auto* basic = std::get_if<BasicSolid>(&scene.solids[as_size(*solid)]);
        if (!basic)
            return std::nullopt;
        v = &basic->volume;
    }
    return std::get<IsotropicVolume>(*v).refractive_index;
}

std::optional<std::vector<SolidLeaf>> SolidCollector::collect() {
    if (!collect(scene_.world.solid))
        return std::nullopt;
    return std::move(leaves_);
}

bool SolidCollector::collect(SolidIndex index) {
    const Solid& solid = scene_.solids[as_size(index)];
    if (const auto* basic = std::get_if<BasicSolid>(&solid))
        return collect(*basic, index);
    return collect(std::get<Aggregate>(solid));
}

bool SolidCollector::collect(const Aggregate& aggregate) {
    const auto place = static_cast<std::uint32_t>(priorities_.size());
    if (place >= limits_.leaves)
        return false;
    priorities_.emplace_back(aggregate.priorities);
    any_priorities_ |= !priorities_.back().empty();
    for (const SolidIndex member : each_once(aggregate.members)) {
        path_.push_back({place, member});
        const bool fits = collect(member);
        path_.pop_back();
        if (!fits)
            return false;
    }
    return true;
}

bool SolidCollector::collect(const BasicSolid& solid, SolidIndex index) {
    const std::optional<double> volume = refractive_index(scene_, solid.volume);
    if (!volume || leaves_.size() == limits_.leaves)
        return false;
    leaf_surfaces_.clear();
    SolidLeaf leaf;
    leaf.solid = index;
    leaf.path = path_;
    leaf.inside = expression(solid.textured_form, false);
    leaf.surfaces = leaf_surfaces_;
    leaf.refractive_index = *volume;
    leaves_.push_back(std::move(leaf));
    leaf_surface_count_ += leaf_surfaces_.size();
    return leaf_surface_count_ <= limits_.leaf_surfaces && surfaces_.size() <= limits_.surfaces;
}

Expression SolidCollector::expression(TexturedFormIndex index, bool complement) {
    if (leaf_surface_count_ + leaf_surfaces_.size() > limits_.leaf_surfaces)
        return {}; // beyond the limits already
    const TexturedForm& form = scene_.textured_forms[as_size(index)];
    if (const auto* basic = std::get_if<BasicTexturedForm>(&form)) {
        const Side side = surfaces_.add(scene_.forms[as_size(basic->form)], complement);
        LeafSurface surface{side, basic->texture_in, basic->texture_out};
        if (complement)
            std::swap(surface.texture_in, surface.texture_out);
        leaf_surfaces_.push_back(surface);
        return Expression::inside(side.surface, side.negated);
    }
    if (const auto* of = std::get_if<Complement>(&form))
        return expression(of->of, !complement);
    const bool is_union = std::holds_alternative<Union>(form);
    const auto& members =
        is_union ? std::get<Union>(form).members : std::get<Intersection>(form).members;
    std::vector<Expression> parts;
    for (const TexturedFormIndex member : members)
        parts.push_back(expression(member, complement));
    return Expression::joined(
        is_union != complement ? Expression::Kind::any : Expression::Kind::all, std::move(parts));
}

SolidCollector::Parting SolidCollector::parting(const SolidLeaf& a, const SolidLeaf& b) const {
    std::size_t level = 0;
    while (a.path[level].member == b.path[level].member)
        ++level; // two leaves part somewhere
    return {priorities_[a.path[level].aggregate], a.path[level].member, b.path[level].member};
}

bool SolidCollector::displaces(const SolidLeaf& a, const SolidLeaf& b) const {
    const Parting p = parting(a, b);
    return p.priorities.above(p.a, p.b);
}

} // namespace fraja::kernel
