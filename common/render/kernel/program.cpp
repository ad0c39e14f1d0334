#include "common/render/kernel/program.hpp"

#include "common/render/kernel/reach.hpp"
#include "common/render/kernel/triples.hpp"
#include "common/render/overlap_message.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <numeric>
#include <set>
#include <utility>
#include <variant>

namespace fraja::kernel {
namespace {

/// A box around the places of a scene.
class Bounds {
public:
    void add(const Vec3& p, double radius) {
        const double r = std::abs(radius);
        for (int c = 0; c < 3; ++c) {
            low_[c] = std::min(low_[c], p[c] - r);
            high_[c] = std::max(high_[c], p[c] + r);
        }
    }
    [[nodiscard]] Vec3 middle() const { return low_ * 0.5 + high_ * 0.5; }
    [[nodiscard]] double half_size() const {
        const Vec3 size = high_ - low_;
        return 0.5 * std::max({size.x, size.y, size.z});
    }

private:
    Vec3 low_{1e300, 1e300, 1e300}, high_{-1e300, -1e300, -1e300};
};

const HorizontalCamera& eye_of(const Camera& camera) {
    const auto* stereo = std::get_if<StereoCamera>(&camera);
    return stereo ? stereo->eye : std::get<HorizontalCamera>(camera);
}

/// The world's origin; the middle of a scene that is far from it for its size.
Vec3 center_of(const Scene& scene) {
    Bounds bounds;
    bounds.add(eye_of(scene.camera).origin, 0);
    for (const Form& form : scene.forms) {
        if (const auto* sphere = std::get_if<Sphere>(&form))
            bounds.add(sphere->center, sphere->radius);
        else if (const auto* cylinder = std::get_if<Cylinder>(&form))
            bounds.add(cylinder->origin, cylinder->radius);
        else if (const auto* cone = std::get_if<Cone>(&form))
            bounds.add(cone->origin, 0);
    }
    const Vec3 middle = bounds.middle();
    constexpr double far = 16;
    if (!is_finite(middle) || length(middle) <= far * bounds.half_size())
        return {};
    return middle;
}

Vec3 leftwards(const Vec3& dir) {
    const Vec3 left = normalized({-dir.y, dir.x, 0});
    return is_finite(left) ? left : Vec3{0, 1, 0};
}

std::uint64_t bit(std::size_t index) {
    return std::uint64_t{1} << (index & 63);
}

} // namespace

Program::Program(const Scene& scene, const SolidLimits& limits, const std::set<SolidIndex>& listed,
                 const Vec3& center)
    : collector_(center), solids_(scene, limits, listed, collector_) {
    static std::atomic<std::uint64_t> scenes = 0;
    tables_.scene = ++scenes;
    put(tables_.center, center);
}

std::unique_ptr<const Program> Program::compile(const Scene& scene, const SolidLimits& limits) {
    std::set<SolidIndex> listed;
    for (;;) {
        std::unique_ptr<Program> program(new Program(scene, limits, listed, center_of(scene)));
        if (!program->collect(scene))
            return nullptr;
        const auto back = program->leave_out_hidden(limits);
        if (back.empty()) {
            program->build();
            return program;
        }
        listed.insert(back.begin(), back.end());
    }
}

bool Program::collect(const Scene& scene) {
    add_camera(scene);
    const std::vector<BoundingSphere> starts = screen();
    const auto is_outside = [&](const Sphere& sphere) {
        const SphereSurface s = surface_of(sphere, vec(tables_.center));
        return std::ranges::all_of(starts, [&](const BoundingSphere& places) {
            return side_of(s, places.center) > places.radius;
        });
    };
    auto leaves = solids_.collect(is_outside);
    const auto ambient = refractive_index(scene, scene.world.ambient_volume);
    if (!leaves || !ambient)
        return false;
    materials_ = collect_materials(scene);
    solid_leaves_ = std::move(*leaves);
    spheres_apart_ = solids_.take_spheres_apart();
    for (const SphereApart& apart : spheres_apart_)
        apart_surfaces_.push_back(surface_of(apart.sphere, vec(tables_.center)));
    tables_.ambient_index = *ambient;
    put(tables_.ambient, scene.world.ambient_light);
    tables_.any_ambient = scene.world.ambient_light != Rgb{};
    put(tables_.background, scene.world.background_light);
    add_lights(scene);
    add_surfaces();
    return true;
}

void Program::build() {
    sort_leaves();
    build_hierarchy();
    add_leaves();
    add_relations();
    find_features();
    if (tables_.stateful)
        for (Light& light : lights_)
            find_filler(light);
    point_tables();
}

// ------------------------------------------------------------------------------ surfaces, leaves

namespace {

void renumber(Expression& e, const std::vector<std::uint32_t>& new_number) {
    if (e.kind == Expression::Kind::literal)
        e.surface = new_number[e.surface];
    for (Expression& part : e.parts)
        renumber(part, new_number);
}

void renumber(std::vector<SolidLeaf>& leaves, const std::vector<std::uint32_t>& new_number) {
    for (SolidLeaf& leaf : leaves) {
        renumber(leaf.inside, new_number);
        for (LeafSurface& surface : leaf.surfaces)
            surface.side.surface = new_number[surface.side.surface];
    }
}

template <class T>
void erase_marked(std::vector<T>& from, const std::vector<bool>& marked) {
    std::size_t i = 0;
    std::erase_if(from, [&](const T&) { return marked[i++]; });
}

/// Whether each leaf is the inside of a surface of its own.
bool are_surfaces(const std::vector<SolidLeaf>& leaves) {
    std::set<std::uint32_t> seen;
    return std::all_of(leaves.begin(), leaves.end(), [&](const SolidLeaf& leaf) {
        return leaf.inside.kind == Expression::Kind::literal && !leaf.inside.negated &&
               seen.insert(leaf.inside.surface).second;
    });
}

} // namespace

void Program::add_surfaces() {
    surfaces_ = collector_.sorted();
    renumber(solid_leaves_, surfaces_.new_number);
}

/// Of solids that no ray can reach nothing is kept, nor of surfaces that only they have. Answers
/// which solids should not stand apart after all: rays can be in glass when they meet them, or they
/// are few, since others are hidden.
std::vector<SolidIndex> Program::leave_out_hidden(const SolidLimits& limits) {
    const std::vector<BoundingSphere> starts = screen();
    const Reach::Scene scene{solid_leaves_,
                             surfaces_,
                             materials_,
                             tables_.camera,
                             starts,
                             !lights_.empty(),
                             [&](std::size_t a, std::size_t b) {
                                 return solids_.displaces(solid_leaves_[a], solid_leaves_[b]);
                             }};
    const Reach reach(scene);
    tables_.camera_is_outside = reach.camera_is_outside();
    const std::vector<bool> hidden = reach.hidden_spheres(apart_surfaces_);
    erase_marked(spheres_apart_, hidden);
    erase_marked(apart_surfaces_, hidden);
    std::vector<SolidIndex> back;
    for (std::size_t i = 0; i < spheres_apart_.size(); ++i)
        if (spheres_apart_.size() < limits.spheres_apart_min ||
            reach.meets_glass(apart_surfaces_[i]))
            back.push_back(spheres_apart_[i].solid);
    erase_marked(solid_leaves_, reach.hidden_leaves());
    std::vector<bool> used(surfaces_.size(), false);
    for (const SolidLeaf& leaf : solid_leaves_)
        for (const LeafSurface& s : leaf.surfaces)
            used[s.side.surface] = true;
    renumber(solid_leaves_, surfaces_.keep(used));
    return back;
}

/// The leaf of a surface gets its number, where all are such.
void Program::sort_leaves() {
    tables_.leaf_is_surface =
        are_surfaces(solid_leaves_) && solid_leaves_.size() == surfaces_.size();
    if (tables_.leaf_is_surface)
        std::ranges::sort(solid_leaves_, {},
                          [](const SolidLeaf& leaf) { return leaf.inside.surface; });
}

void Program::build_hierarchy() {
    bvh_ = build_bvh(apart_surfaces_);
    bvh_spheres_.reserve(apart_surfaces_.size());
    bvh_materials_.reserve(apart_surfaces_.size());
    bvh_solids_.reserve(apart_surfaces_.size());
    for (const std::uint32_t i : bvh_.order) {
        bvh_spheres_.push_back(apart_surfaces_[i]);
        bvh_materials_.push_back(materials_[spheres_apart_[i].texture]);
        bvh_solids_.push_back(spheres_apart_[i].solid);
    }
    bvh_.order = {};
    apart_surfaces_ = {};
    spheres_apart_ = {};
}

void Program::add_leaves() {
    leaf_of_surface_.assign(surfaces_.size(), none);
    entry_keys_.assign(surfaces_.size(), 0);
    for (const SolidLeaf& leaf : solid_leaves_)
        add_leaf(leaf);
    in_composite_ = std::make_unique<bool[]>(surfaces_.size());
    for (const std::uint32_t leaf : composite_leaves_)
        for (const LeafSurface& surface : solid_leaves_[leaf].surfaces)
            in_composite_[surface.side.surface] = true;
    user_begin_.assign(surfaces_.size() + 1, 0);
    for (const Patch& patch : patches_)
        ++user_begin_[patch.surface + 1];
    std::partial_sum(user_begin_.begin(), user_begin_.end(), user_begin_.begin());
    users_.resize(patches_.size());
    std::vector<std::uint32_t> next(user_begin_.begin(), user_begin_.end());
    for (std::size_t i = 0; i < patches_.size(); ++i)
        users_[next[patches_[i].surface]++] = static_cast<std::uint32_t>(i);
}

void Program::add_leaf(const SolidLeaf& leaf) {
    const auto index = static_cast<std::uint32_t>(leaves_.size());
    const BoundingSphere bounds = bounding_sphere(leaf.inside, surfaces_);
    Leaf entry{};
    entry.root = node_of(leaf.inside);
    entry.refractive_index = leaf.refractive_index;
    put(entry.center, bounds.center);
    entry.radius = bounds.radius;
    entry.surface_begin = static_cast<std::uint32_t>(leaf_surfaces_.size());
    std::int32_t* simple = nullptr;
    if (leaf.inside.kind == Expression::Kind::literal && !leaf.inside.negated)
        simple = &leaf_of_surface_[leaf.inside.surface];
    if (simple && *simple == none)
        *simple = static_cast<std::int32_t>(index);
    else
        composite_leaves_.push_back(index);
    std::set<std::pair<std::uint32_t, bool>> seen;
    for (const LeafSurface& s : leaf.surfaces) {
        leaf_surfaces_.push_back(s.side.surface);
        if (!seen.insert({s.side.surface, s.side.negated}).second)
            continue;
        if (simple && *simple == static_cast<std::int32_t>(index) && !s.side.negated &&
            s.side.surface == leaf.inside.surface)
            entry_keys_[s.side.surface] = static_cast<std::uint32_t>(2 * patches_.size());
        patches_.push_back({index, s.side.surface, s.side.negated, materials_[s.texture_in],
                            materials_[s.texture_out]});
    }
    entry.surface_count = static_cast<std::uint32_t>(leaf_surfaces_.size()) - entry.surface_begin;
    leaves_.push_back(entry);
}

Node Program::node_of(const Expression& e) {
    Node node;
    node.kind = static_cast<Node::Kind>(e.kind); // the same names in the same order
    node.negated = e.negated;
    node.first = e.surface;
    if (e.parts.empty())
        return node;
    node.count = static_cast<std::uint32_t>(e.parts.size());
    node.first = static_cast<std::uint32_t>(nodes_.size());
    nodes_.resize(nodes_.size() + e.parts.size());
    for (std::uint32_t i = 0; i < node.count; ++i)
        nodes_[node.first + i] = node_of(e.parts[i]);
    return node;
}

/// A leaf shows when entered where another fills the space, and displaces it, by the same rule;
/// kept both ways for reading by rows.
void Program::add_relations() {
    const std::size_t count = solid_leaves_.size();
    const std::size_t words = (count + 63) / 64;
    tables_.leaf_words = static_cast<std::uint32_t>(words);
    relations_.assign(2 * count * words, 0);
    std::uint64_t* shows_in = relations_.data();
    std::uint64_t* displaced_by = relations_.data() + count * words;
    std::size_t related = 0; // pairs, in either order
    const auto relate = [&](std::size_t a, std::size_t b) {
        if (!solids_.displaces(solid_leaves_[a], solid_leaves_[b]))
            return false;
        displaced_by[a * words + b / 64] |= bit(b);
        shows_in[b * words + a / 64] |= bit(a);
        return true;
    };
    if (solids_.any_priorities())
        for (std::size_t a = 0; a < count; ++a)
            for (std::size_t b = 0; b < a; ++b) {
                const bool above = relate(a, b), below = relate(b, a);
                related += above || below;
            }
    tables_.any_relations = related > 0;
    tables_.all_relations = count < 2 || related == count * (count - 1) / 2;
}

std::vector<SolidIndex> Program::solids() const {
    std::vector<SolidIndex> solids;
    for (const SolidLeaf& leaf : solid_leaves_)
        solids.push_back(leaf.solid);
    return solids;
}

SolidIndex Program::solid_of(std::int64_t what) const {
    const auto index = static_cast<std::size_t>(what);
    return index < solid_leaves_.size() ? solid_leaves_[index].solid
                                        : bvh_solids_[index - solid_leaves_.size()];
}

std::string Program::overlap_message(const Scene& scene,
                                     std::span<const std::uint32_t> leaves) const {
    if (leaves.size() < 2) // rounding took one out of the set again
        return "solids overlap where a ray passes and none has priority over the others; give each "
               "a label of its own and say in priorities which is above the other";
    const auto parting = [&](std::uint32_t a, std::uint32_t b) {
        return solids_.parting(solid_leaves_[a], solid_leaves_[b]);
    };
    for (const std::uint32_t a : leaves)
        for (const std::uint32_t b : leaves) {
            if (a >= b)
                continue;
            const SolidCollector::Parting p = parting(a, b);
            const SolidIndex pair[] = {p.a, p.b};
            if (!p.priorities.above(p.a, p.b) && !p.priorities.above(p.b, p.a))
                return fraja::overlap_message(scene, p.priorities, pair);
        }
    // Each two are related: in a circle, at the place where the first ones part.
    const SolidCollector::Parting first = parting(leaves[0], leaves[1]);
    std::vector<SolidIndex> members{first.a};
    for (const std::uint32_t leaf : leaves.subspan(1))
        if (const auto p = parting(leaves[0], leaf);
            &p.priorities == &first.priorities &&
            std::find(members.begin(), members.end(), p.b) == members.end())
            members.push_back(p.b);
    return fraja::overlap_message(scene, first.priorities, members);
}

// --------------------------------------------------------------------------------- what is seen

void Program::add_camera(const Scene& scene) {
    const HorizontalCamera& eye = eye_of(scene.camera);
    CameraTable& c = tables_.camera;
    const Vec3 origin = eye.origin - vec(tables_.center);
    const Vec3 dir = normalized(eye.direction);
    const Vec3 middle = origin + eye.focal * dir;
    const Vec3 left = leftwards(dir);
    const Vec3 half_left = (eye.screen_width / 2) * left;
    const Vec3 half_up = (eye.screen_height / 2) * cross(dir, left);
    const Vec3 top_left = middle + (half_left + half_up);
    put(c.origin, origin), put(c.direction, dir), put(c.top_left, top_left);
    put(c.rightwards, (middle + (-half_left + half_up)) - top_left);
    put(c.downwards, (middle + (half_left + -half_up)) - top_left);
    if (const auto* stereo = std::get_if<StereoCamera>(&scene.camera)) {
        c.stereo = true;
        put(c.to_left_eye, (stereo->step / 2) * leftwards(eye.direction));
    }
}

/// Spheres around the places where camera rays start: the screen, which is a rectangle, or two.
std::vector<BoundingSphere> Program::screen() const {
    const CameraTable& c = tables_.camera;
    constexpr int parts = 4; // of the screen, each way
    const Vec3 part_across = vec(c.rightwards) / double{parts};
    const Vec3 part_down = vec(c.downwards) / double{parts};
    const double part_radius = 0.5 * length(part_across) + 0.5 * length(part_down);
    const Vec3 aside = vec(c.to_left_eye);
    std::vector<BoundingSphere> places;
    for (int i = 0; i < parts * parts; ++i)
        for (const Vec3& eye : {aside, -aside}) {
            const Vec3 p = vec(c.top_left) + (0.5 + i % parts) * part_across +
                           (0.5 + i / parts) * part_down + eye;
            places.push_back({p, part_radius + 1e-9 * length(p)});
        }
    return places;
}

void Program::find_features() {
    const bool enterable = std::ranges::any_of(
        patches_, [&](const Patch& patch) { return materials_.table[patch.material_out].glass; });
    for (std::uint32_t surface = 0; surface < surfaces_.size(); ++surface) {
        std::set<std::uint32_t> leaves;
        for (std::uint32_t u = user_begin_[surface]; u < user_begin_[surface + 1]; ++u)
            leaves.insert(patches_[users_[u]].leaf);
        tables_.shared_surfaces |= leaves.size() > 1;
    }
    tables_.stateful = enterable || !tables_.camera_is_outside;
    tables_.surface_words =
        tables_.stateful ? static_cast<std::uint32_t>((surfaces_.size() + 63) / 64) : 0;
}

void Program::add_lights(const Scene& scene) {
    const auto add = [&](Light light, const Rgb& rgb) {
        put(light.rgb, rgb);
        if (rgb != Rgb{})
            lights_.push_back(light);
    };
    for (const fraja::Light& source : scene.world.lights) {
        Light light{};
        light.within = none;
        if (const auto* point = std::get_if<PointLight>(&source)) {
            light.point = true;
            put(light.to, point->origin - vec(tables_.center));
            add(light, point->light);
        } else {
            const auto& directional = std::get<DirectionalLight>(source);
            put(light.to, normalized(-directional.direction));
            add(light, directional.light);
        }
    }
}

/// What fills the place of a point light; unknown near a surface, where it depends on rounding.
void Program::find_filler(Light& light) const {
    if (!light.point)
        return;
    const Vec3 p = vec(light.to);
    std::vector<bool> inside(surfaces_.size());
    for (std::uint32_t s = 0; s < inside.size(); ++s) {
        const auto [side, error] = surfaces_.side_of(s, p);
        if (!(std::abs(side) > error + 1e-9 * (length(p) + std::abs(side))))
            return;
        inside[s] = side < 0;
    }
    std::vector<std::size_t> within;
    for (std::size_t i = 0; i < solid_leaves_.size(); ++i)
        if (solid_leaves_[i].inside.holds([&](std::uint32_t s) { return inside[s]; }))
            within.push_back(i);
    if (within.empty()) {
        light.within_known = true;
        return;
    }
    for (const std::size_t a : within)
        if (std::all_of(within.begin(), within.end(), [&](std::size_t b) {
                return a == b || solids_.displaces(solid_leaves_[a], solid_leaves_[b]);
            })) {
            light.within = static_cast<std::int32_t>(a);
            light.within_known = true;
            return;
        }
}

void Program::point_tables() {
    Tables& t = tables_;
    t.spheres = surfaces_.spheres.data(), t.planes = surfaces_.planes.data();
    t.cylinders = surfaces_.cylinders.data(), t.cones = surfaces_.cones.data();
    const auto count = [](const auto& table) { return static_cast<std::uint32_t>(table.size()); };
    t.sphere_count = count(surfaces_.spheres), t.plane_count = count(surfaces_.planes);
    t.cylinder_count = count(surfaces_.cylinders), t.cone_count = count(surfaces_.cones);
    t.surface_count = static_cast<std::uint32_t>(surfaces_.size());
    t.leaves = leaves_.data(), t.leaf_count = count(leaves_);
    t.nodes = nodes_.data();
    t.leaf_surfaces = leaf_surfaces_.data();
    t.leaf_of_surface = leaf_of_surface_.data();
    t.entry_keys = entry_keys_.data();
    t.composite_leaves = composite_leaves_.data();
    t.composite_leaf_count = count(composite_leaves_);
    t.in_composite = in_composite_.get();
    t.patches = patches_.data(), t.users = users_.data(), t.user_begin = user_begin_.data();
    t.shows_in = relations_.data();
    t.displaced_by = relations_.data() + std::size_t{t.leaf_count} * t.leaf_words;
    t.bvh = bvh_.nodes.empty() ? nullptr : bvh_.nodes.data();
    t.bvh_spheres = bvh_spheres_.data(), t.bvh_materials = bvh_materials_.data();
    t.bvh_sphere_count = count(bvh_spheres_);
    t.materials = materials_.table.data(), t.material_count = count(materials_.table);
    t.lights = lights_.data(), t.light_count = count(lights_);
}

} // namespace fraja::kernel
