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

std::optional<std::vector<SolidLeaf>>
SolidCollector::collect(const std::function<bool(const Sphere&)>& is_outside) {
    find_spheres_apart(is_outside);
    if (!collect(scene_.world.solid))
        return std::nullopt;
    return std::move(leaves_);
}

const BasicTexturedForm* SolidCollector::lone_opaque_sphere(const BasicSolid& solid) const {
    const auto* form =
        std::get_if<BasicTexturedForm>(&scene_.textured_forms[as_size(solid.textured_form)]);
    if (!form || !std::holds_alternative<Sphere>(scene_.forms[as_size(form->form)]))
        return nullptr;
    const Texture& outside = scene_.textures[as_size(form->texture_out)];
    const auto* plain = std::get_if<PlainTexture>(&outside);
    const Rgb& ktg = plain ? plain->local.ktg : std::get<ChequeredTexture>(outside).kt;
    return ktg == Rgb{} ? form : nullptr;
}

/// A scene with priorities has none: where a solid displaces others, all are leaves.
void SolidCollector::find_spheres_apart(const std::function<bool(const Sphere&)>& is_outside) {
    std::vector<std::uint8_t> uses(scene_.forms.size(), 0); // of a form, up to 2
    for (const TexturedForm& textured : scene_.textured_forms)
        if (const auto* basic = std::get_if<BasicTexturedForm>(&textured))
            uses[as_size(basic->form)] =
                static_cast<std::uint8_t>(std::min(uses[as_size(basic->form)] + 1, 2));
    std::size_t count = 0;
    std::vector<bool> candidates(scene_.solids.size(), false);
    for (std::size_t i = 0; i < scene_.solids.size(); ++i) {
        if (const auto* aggregate = std::get_if<Aggregate>(&scene_.solids[i]);
            aggregate && !aggregate->priorities.empty())
            return;
        const auto* basic = std::get_if<BasicSolid>(&scene_.solids[i]);
        const BasicTexturedForm* form = basic ? lone_opaque_sphere(*basic) : nullptr;
        if (!form || uses[as_size(form->form)] > 1 ||
            !is_outside(std::get<Sphere>(scene_.forms[as_size(form->form)])))
            continue;
        candidates[i] = true;
        ++count;
    }
    if (count >= limits_.spheres_apart_min)
        is_apart_ = std::move(candidates);
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
    if (!is_apart_.empty() && is_apart_[as_size(index)]) {
        const BasicTexturedForm& form = *lone_opaque_sphere(solid);
        apart_.push_back({std::get<Sphere>(scene_.forms[as_size(form.form)]), form.texture_out});
        return true;
    }
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
