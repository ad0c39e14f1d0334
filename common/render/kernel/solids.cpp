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
    find_named();
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

namespace {

/// How often something is referred to, as far as it matters.
class Uses {
public:
    explicit Uses(std::size_t count) : uses_(count, 0) {}
    void add(std::size_t index) {
        uses_[index] = static_cast<std::uint8_t>(std::min(uses_[index] + 1, 2));
    }
    [[nodiscard]] bool many(std::size_t index) const { return uses_[index] > 1; }

private:
    std::vector<std::uint8_t> uses_;
};

} // namespace

void SolidCollector::find_named() {
    is_named_.assign(scene_.solids.size(), false);
    for (const Solid& solid : scene_.solids)
        if (const auto* aggregate = std::get_if<Aggregate>(&solid))
            for (const Priority& pair : aggregate->priorities)
                is_named_[as_size(pair.above)] = is_named_[as_size(pair.below)] = true;
}

void SolidCollector::find_spheres_apart(const std::function<bool(const Sphere&)>& is_outside) {
    Uses forms(scene_.forms.size()), textured_forms(scene_.textured_forms.size());
    for (const TexturedForm& textured : scene_.textured_forms) {
        const auto add = [&](TexturedFormIndex member) { textured_forms.add(as_size(member)); };
        if (const auto* basic = std::get_if<BasicTexturedForm>(&textured))
            forms.add(as_size(basic->form));
        else if (const auto* of = std::get_if<Complement>(&textured))
            add(of->of);
        else if (const auto* any = std::get_if<Union>(&textured))
            std::ranges::for_each(any->members, add);
        else
            std::ranges::for_each(std::get<Intersection>(textured).members, add);
    }
    for (const Solid& solid : scene_.solids)
        if (const auto* basic = std::get_if<BasicSolid>(&solid))
            textured_forms.add(as_size(basic->textured_form));
    std::size_t count = 0;
    std::vector<bool> candidates(scene_.solids.size(), false);
    for (std::size_t i = 0; i < scene_.solids.size(); ++i) {
        const auto* basic = std::get_if<BasicSolid>(&scene_.solids[i]);
        const BasicTexturedForm* form = basic ? lone_opaque_sphere(*basic) : nullptr;
        if (!form || is_named_[i] || listed_.contains(static_cast<SolidIndex>(i)) ||
            forms.many(as_size(form->form)) || textured_forms.many(as_size(basic->textured_form)) ||
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
        named_on_path_ += is_named_[as_size(member)] ? 1U : 0U;
        const bool fits = collect(member);
        named_on_path_ -= is_named_[as_size(member)] ? 1U : 0U;
        path_.pop_back();
        if (!fits)
            return false;
    }
    return true;
}

bool SolidCollector::collect(const BasicSolid& solid, SolidIndex index) {
    if (!is_apart_.empty() && is_apart_[as_size(index)] && named_on_path_ == 0) {
        if (apart_.size() == limits_.spheres_apart_max)
            return false;
        const BasicTexturedForm& form = *lone_opaque_sphere(solid);
        apart_.push_back(
            {std::get<Sphere>(scene_.forms[as_size(form.form)]), form.texture_out, index});
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
