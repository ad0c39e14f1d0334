#include "common/scene/canonical_order.hpp"

#include "common/base/assert.hpp"

#include <utility>

namespace fraja {
namespace {

/// Old and new places of one table's entries.
template <class Index>
class Order {
public:
    explicit Order(std::size_t count) : new_of_(count, unseen) {}

    [[nodiscard]] bool seen(Index i) const { return new_of_[as_size(i)] != unseen; }
    void append(Index i) {
        new_of_[as_size(i)] = static_cast<std::uint32_t>(old_of_.size());
        old_of_.push_back(i);
        unchanged_ = unchanged_ && as_size(i) + 1 == old_of_.size();
    }
    [[nodiscard]] bool unchanged() const { return unchanged_ && old_of_.size() == new_of_.size(); }
    void renumber(Index& i) const { i = Index{new_of_[as_size(i)]}; }

    template <class T>
    [[nodiscard]] std::vector<T> rearrange(std::vector<T> table) const {
        std::vector<T> sorted;
        sorted.reserve(old_of_.size());
        for (const Index i : old_of_)
            sorted.push_back(std::move(table[as_size(i)]));
        return sorted;
    }

private:
    static constexpr std::uint32_t unseen = UINT32_MAX;
    std::vector<std::uint32_t> new_of_;
    std::vector<Index> old_of_;
    bool unchanged_ = true;
};

struct Orders {
    explicit Orders(const Scene& s)
        : scene(s), forms(s.forms.size()), textures(s.textures.size()),
          textured_forms(s.textured_forms.size()), solids(s.solids.size()) {}

    const Scene& scene;
    Order<FormIndex> forms;
    Order<TextureIndex> textures;
    Order<TexturedFormIndex> textured_forms;
    Order<SolidIndex> solids;

    void visit(FormIndex i) {
        if (!forms.seen(i))
            forms.append(i);
    }
    void visit(TextureIndex i) {
        if (!textures.seen(i))
            textures.append(i);
    }
    void visit(TexturedFormIndex i) {
        if (textured_forms.seen(i))
            return;
        std::visit([this](const auto& parts) { visit_parts(parts); },
                   scene.textured_forms[as_size(i)]);
        textured_forms.append(i);
    }
    void visit(SolidIndex i) {
        if (solids.seen(i))
            return;
        std::visit([this](const auto& parts) { visit_parts(parts); }, scene.solids[as_size(i)]);
        solids.append(i);
    }
    void visit(const Volume& volume) {
        if (const auto* solid = std::get_if<SolidIndex>(&volume))
            visit(*solid);
    }

    void visit_parts(const BasicTexturedForm& b) {
        visit(b.form), visit(b.texture_in), visit(b.texture_out);
    }
    void visit_parts(const Union& u) {
        for (const TexturedFormIndex member : u.members)
            visit(member);
    }
    void visit_parts(const Intersection& n) {
        for (const TexturedFormIndex member : n.members)
            visit(member);
    }
    void visit_parts(const Complement& c) { visit(c.of); }
    void visit_parts(const BasicSolid& b) { visit(b.textured_form), visit(b.volume); }
    void visit_parts(const Aggregate& a) {
        for (const SolidIndex member : a.members)
            visit(member);
        for (const Priority& priority : a.priorities)
            visit(priority.above), visit(priority.below);
    }
};

struct Renumber {
    const Orders& orders;

    void operator()(BasicTexturedForm& b) const {
        orders.forms.renumber(b.form);
        orders.textures.renumber(b.texture_in);
        orders.textures.renumber(b.texture_out);
    }
    void operator()(Union& u) const { members(u.members); }
    void operator()(Intersection& n) const { members(n.members); }
    void operator()(Complement& c) const { orders.textured_forms.renumber(c.of); }
    void operator()(BasicSolid& b) const {
        orders.textured_forms.renumber(b.textured_form);
        volume(b.volume);
    }
    void operator()(Aggregate& a) const {
        for (SolidIndex& member : a.members)
            orders.solids.renumber(member);
        for (Priority& p : a.priorities) {
            orders.solids.renumber(p.above);
            orders.solids.renumber(p.below);
        }
    }
    void members(std::vector<TexturedFormIndex>& list) const {
        for (TexturedFormIndex& member : list)
            orders.textured_forms.renumber(member);
    }
    void volume(Volume& v) const {
        if (auto* solid = std::get_if<SolidIndex>(&v))
            orders.solids.renumber(*solid);
    }
};

} // namespace

Scene canonical_order(Scene scene) {
    FRAJA_ASSERT(scene.solid_names.size() == scene.solids.size());
    Orders orders(scene);
    orders.visit(scene.world.solid);
    orders.visit(scene.world.ambient_volume);
    if (orders.forms.unchanged() && orders.textures.unchanged() &&
        orders.textured_forms.unchanged() && orders.solids.unchanged())
        return scene; // nearly always: no need to move what may be gigabytes

    scene.forms = orders.forms.rearrange(std::move(scene.forms));
    scene.textures = orders.textures.rearrange(std::move(scene.textures));
    scene.textured_forms = orders.textured_forms.rearrange(std::move(scene.textured_forms));
    scene.solids = orders.solids.rearrange(std::move(scene.solids));
    scene.solid_names = orders.solids.rearrange(std::move(scene.solid_names));
    const Renumber renumber{orders};
    for (TexturedForm& textured_form : scene.textured_forms)
        std::visit(renumber, textured_form);
    for (Solid& solid : scene.solids)
        std::visit(renumber, solid);
    orders.solids.renumber(scene.world.solid);
    renumber.volume(scene.world.ambient_volume);
    return scene;
}

} // namespace fraja
