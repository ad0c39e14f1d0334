#include "tests/stress/solid_cases.hpp"

#include "common/render/kernel/program.hpp"
#include "common/render/kernel/refine.hpp"
#include "common/render/kernel/walk.hpp"
#include "tests/stress/lanes.hpp"
#include "tests/stress/quad.hpp"
#include "tests/stress/random_vectors.hpp"
#include "tests/support/scene_builder.hpp"

#include <algorithm>
#include <cmath>
#include <variant>

namespace fraja::stress {
namespace {

using kernel::none;
using kernel::Wide3;
using kernel::WideInt;

// ------------------------------------------------------------------------------------- the scenes

/// How the forms of a regime are related.
enum class Kin : std::uint8_t { unrelated, same, nearly_same, shells };

/// Forms of about unit size about the origin, made smaller or larger, and moved.
class SceneMaker {
public:
    SceneMaker(Rng& rng, Kin kin) : rng_(rng), kin_(kin) {
        scale_ = magnitude_between(rng, -9, 9);
        place_ = (scale_ * magnitude_between(rng, 0, 9)) * direction(rng);
    }

    /// One to three solids, each two of which have a priority.
    Scene make() {
        const TextureIndex clear = builder_.texture(glass());
        std::vector<SolidIndex> solids;
        for (std::size_t n = 1 + rng_.below(3); n > 0; --n)
            solids.push_back(builder_.solid(tree(clear, 3), IsotropicVolume{1}));
        std::vector<Priority> priorities;
        for (std::size_t i = 0; i < solids.size(); ++i)
            for (std::size_t j = i + 1; j < solids.size(); ++j)
                priorities.push_back({solids[i], solids[j]});
        builder_.aggregate(solids, priorities);
        // For a light's rays may start everywhere: nothing is left out.
        builder_.scene.world.lights = {PointLight{place_, {1, 1, 1}}};
        auto& camera = std::get<HorizontalCamera>(builder_.scene.camera);
        camera.origin = place_ + Vec3{30 * scale_, 0, 0};
        camera.focal = camera.screen_width = camera.screen_height = scale_;
        return builder_.scene;
    }
    [[nodiscard]] double scale() const { return scale_; }
    [[nodiscard]] const Vec3& place() const { return place_; }

private:
    Vec3 near_the_middle() { return place_ + (scale_ * rng_.between(0, 1)) * direction(rng_); }

    Form form() {
        const std::uint64_t kind = kin_ == Kin::shells ? 0 : rng_.below(5);
        if (kind == 3)
            return Plane{near_the_middle(), direction(rng_) * rng_.between(0.1, 10)};
        if (kind == 4)
            return Cylinder{near_the_middle(), direction(rng_), scale_ * rng_.between(0.2, 1)};
        return Sphere{near_the_middle(), scale_ * rng_.between(0.3, 1.5)};
    }
    /// The same set of points in other words, or nearly so.
    Form again(const Form& form) {
        const double factor = kin_ == Kin::nearly_same ? 1 + magnitude_between(rng_, -12, -9) : 1.0;
        if (const auto* plane = std::get_if<Plane>(&form))
            return Plane{plane->origin, plane->normal * (rng_.below(2) == 0 ? 2.0 : 0.5)};
        if (const auto* cylinder = std::get_if<Cylinder>(&form))
            return Cylinder{cylinder->origin, -cylinder->direction, cylinder->radius * factor};
        const auto& sphere = std::get<Sphere>(form);
        return Sphere{sphere.center, sphere.radius * factor};
    }
    TexturedFormIndex bare(TextureIndex texture) {
        if (kin_ == Kin::shells) {
            const auto outer = std::get<Sphere>(form());
            const double wall = magnitude_between(rng_, -12, -3);
            const TexturedFormIndex hollow = builder_.textured(Complement{
                builder_.textured(Sphere{outer.center, outer.radius * (1 - wall)}, texture)});
            return builder_.textured(Intersection{{builder_.textured(outer, texture), hollow}});
        }
        const bool old = kin_ != Kin::unrelated && !forms_.empty() && rng_.below(2) == 0;
        if (old)
            return builder_.textured(again(forms_[rng_.below(forms_.size())]), texture);
        forms_.push_back(form());
        return builder_.textured(forms_.back(), texture);
    }
    TexturedFormIndex tree(TextureIndex texture, int depth) {
        if (depth == 0 || rng_.below(5) == 0)
            return bare(texture);
        if (rng_.below(4) == 0)
            return builder_.textured(Complement{tree(texture, depth - 1)});
        std::vector<TexturedFormIndex> members;
        for (std::size_t n = 2 + rng_.below(2); n > 0; --n)
            members.push_back(tree(texture, depth - 1));
        return rng_.below(2) == 0 ? builder_.textured(Union{members})
                                  : builder_.textured(Intersection{members});
    }

    Rng& rng_;
    Kin kin_;
    double scale_ = 1;
    Vec3 place_;
    SceneBuilder builder_;
    std::vector<Form> forms_;
};

// -------------------------------------------------------------------------------------- the truth

struct Line {
    Quad3 origin, dir;
    [[nodiscard]] Quad3 at(Quad t) const { return origin + t * dir; }
};

/// A change of what fills the space: by which member of the world's solid; none.
struct Change {
    Quad t;
    std::int32_t filler;
};

bool is_inside(const Form& form, const Quad3& p) {
    if (const auto* plane = std::get_if<Plane>(&form))
        return dot(p - quad(plane->origin), quad(plane->normal)) < 0;
    if (const auto* cylinder = std::get_if<Cylinder>(&form)) {
        const Quad3 off = across(p - quad(cylinder->origin), quad(cylinder->direction));
        return dot(off, off) < Quad{cylinder->radius} * cylinder->radius;
    }
    const auto& sphere = std::get<Sphere>(form);
    const Quad3 off = p - quad(sphere.center);
    return dot(off, off) < Quad{sphere.radius} * sphere.radius;
}

bool is_inside(const Scene& scene, TexturedFormIndex index, const Quad3& p) {
    const TexturedForm& form = scene.textured_forms[as_size(index)];
    if (const auto* basic = std::get_if<BasicTexturedForm>(&form))
        return is_inside(scene.forms[as_size(basic->form)], p);
    if (const auto* complement = std::get_if<Complement>(&form))
        return !is_inside(scene, complement->of, p);
    const auto holds = [&](TexturedFormIndex member) { return is_inside(scene, member, p); };
    if (const auto* any = std::get_if<Union>(&form))
        return std::ranges::any_of(any->members, holds);
    return std::ranges::all_of(std::get<Intersection>(form).members, holds);
}

class Truth {
public:
    Truth(const Scene& scene, const Line& line) : scene_(scene), line_(line) {
        for (const Form& form : scene.forms)
            add_crossings(form);
        std::ranges::sort(crossings_);
    }

    /// Rounding decides whether the line touches a surface at all.
    [[nodiscard]] bool grazes() const { return grazes_; }
    [[nodiscard]] std::vector<Change> changes() const {
        std::vector<Change> changes{{0, filler_between(0, crossings_.empty() ? 2 : crossings_[0])}};
        for (std::size_t i = 0; i < crossings_.size(); ++i) {
            const Quad next = i + 1 < crossings_.size() ? crossings_[i + 1] : 2 * crossings_[i];
            if (next == crossings_[i])
                continue;
            const std::int32_t filler = filler_between(crossings_[i], next);
            if (filler != changes.back().filler)
                changes.push_back({crossings_[i], filler});
        }
        return changes;
    }

private:
    void add(Quad t) {
        if (t > 0)
            crossings_.push_back(t);
    }
    void add_chord(const Quad3& f, const Quad3& d, double radius) {
        const Quad a = dot(d, d), middle = -dot(f, d) / a;
        const Quad3 nearest = f + middle * d;
        const Quad excess = 1 - dot(nearest, nearest) / radius / radius;
        grazes_ |= magnitude(excess) < 1e-10;
        if (excess < 0)
            return;
        const Quad half = root(excess * radius * radius / a);
        add(middle - half), add(middle + half);
    }
    void add_crossings(const Form& form) {
        if (const auto* plane = std::get_if<Plane>(&form)) {
            const Quad3 n = quad(plane->normal);
            add(dot(quad(plane->origin) - line_.origin, n) / dot(line_.dir, n));
        } else if (const auto* cylinder = std::get_if<Cylinder>(&form)) {
            const Quad3 axis = quad(cylinder->direction);
            add_chord(across(line_.origin - quad(cylinder->origin), axis), across(line_.dir, axis),
                      cylinder->radius);
        } else {
            const auto& sphere = std::get<Sphere>(form);
            add_chord(line_.origin - quad(sphere.center), line_.dir, sphere.radius);
        }
    }
    /// The first of the world's members that holds the place: it displaces all that come later.
    [[nodiscard]] std::int32_t filler_between(Quad a, Quad b) const {
        const auto& members =
            std::get<Aggregate>(scene_.solids[as_size(scene_.world.solid)]).members;
        for (std::size_t i = 0; i < members.size(); ++i) {
            const auto& solid = std::get<BasicSolid>(scene_.solids[as_size(members[i])]);
            if (is_inside(scene_, solid.textured_form, line_.at((a + b) / 2)))
                return static_cast<std::int32_t>(as_size(members[i]));
        }
        return none;
    }

    const Scene& scene_;
    Line line_;
    std::vector<Quad> crossings_;
    bool grazes_ = false;
};

// ------------------------------------------------------------------------------------- the kernel

/// What the kernel's walk meets, as tile tracers use it, but for the straight way through all.
std::vector<Change> walk(const kernel::Tables& tables, const std::vector<std::int32_t>& solid_of,
                         const Vec3& start, const Vec3& dir) {
    kernel::Walker walker(tables);
    kernel::WideRays rays{in_all_lanes(start), in_all_lanes(dir),
                          kernel::all_lanes(std::int64_t{none})};
    walker.find_inside(rays.origin, rays.dir);
    const auto solid = [&](std::int64_t leaf) {
        return leaf < 0 ? static_cast<std::int32_t>(leaf)
                        : solid_of[static_cast<std::size_t>(leaf)];
    };
    const auto filler_now = [&] {
        return std::int64_t{
            kernel::filler_of(tables, kernel::LaneSet(walker.find_leaves<true>(), 0))};
    };
    std::int64_t filler = filler_now();
    std::vector<Change> changes{{0, solid(filler)}};
    Quad way = 0;
    constexpr std::size_t changes_max = 200; // three trees of at most 27 surfaces have fewer
    while (changes.size() < changes_max) {
        const auto found =
            walker.first_change<true>(rays, kernel::all_lanes(filler), kernel::never());
        if (found.leaf[0] < 0)
            break;
        walker.settle<true>(found, ~kernel::Mask{});
        const std::int64_t surface = found.surface[0];
        const auto word = static_cast<std::size_t>(surface >> 6);
        const auto bit = static_cast<std::int64_t>(std::uint64_t{1} << (surface & 63));
        const bool outwards = (walker.bits()[word][0] & bit) != 0;
        const kernel::WideHit hit =
            kernel::with_surface(tables, static_cast<std::uint32_t>(surface), [&](const auto& s) {
                return kernel::hit_on(s, rays.origin, rays.dir,
                                      {outwards ? ~kernel::Mask{} : kernel::Mask{},
                                       rays.owner == kernel::all_lanes(surface)});
            });
        walker.bits()[word] ^= kernel::all_lanes(bit);
        filler = filler_now();
        way += Quad{hit.t[0]};
        if (solid(filler) != changes.back().filler)
            changes.push_back({way, solid(filler)});
        rays.origin = hit.place;
        rays.owner = kernel::all_lanes(surface);
    }
    return changes;
}

/// The basic solids of a scene's leaves, by number of Tables.
std::vector<std::int32_t> solids_of(const kernel::Program& program) {
    std::vector<std::int32_t> solids;
    for (const SolidIndex solid : program.solids())
        solids.push_back(static_cast<std::int32_t>(as_size(solid)));
    return solids;
}

bool agree(const std::vector<Change>& got, const std::vector<Change>& want, double tolerance) {
    return std::ranges::equal(got, want, [&](const Change& a, const Change& b) {
        return a.filler == b.filler && magnitude(a.t - b.t) <= tolerance;
    });
}

/// Whether rays without state find the same entry, and see it from before and behind.
bool first_is_found(const kernel::Tables& tables, const std::vector<std::int32_t>& solid_of,
                    const Vec3& start, const Vec3& dir, const std::vector<Change>& want) {
    kernel::Walker walker(tables);
    const kernel::WideRays rays{in_all_lanes(start), in_all_lanes(dir),
                                kernel::all_lanes(std::int64_t{none})};
    const auto found = walker.first_entry<true>(rays, kernel::never());
    const auto met_before = [&](double t) {
        return kernel::any(
            walker.meets_anything<true>(rays, ~kernel::Mask{}, kernel::all_lanes(t)));
    };
    const double t = found.t[0];
    if (want.size() == 1)
        return found.surface[0] < 0 && !met_before(__builtin_inf());
    std::int64_t leaf = found.leaf[0];
    if (leaf < 0 && found.surface[0] >= 0)
        leaf = tables.leaf_of_surface[found.surface[0]];
    return leaf >= 0 && solid_of[static_cast<std::size_t>(leaf)] == want[1].filler &&
           magnitude(Quad{t} - want[1].t) <= 1e-9 * t && met_before(1.001 * t) &&
           !met_before(0.999 * t);
}

Scene opaque(Scene scene) {
    for (Texture& texture : scene.textures)
        texture = PlainTexture{matte(0.5)};
    return scene;
}

template <Kin kin>
Walks run(Rng& rng, std::uint64_t rays) {
    Walks walks;
    constexpr int rays_per_scene = 8;
    while (walks.rays < rays) {
        SceneMaker maker(rng, kin);
        const Scene scene = maker.make();
        const auto program = kernel::Program::compile(scene);
        if (!program || !program->tables().stateful)
            continue; // trees that are nothing at all
        const Vec3 center{program->tables().center[0], program->tables().center[1],
                          program->tables().center[2]};
        const std::vector<std::int32_t> solid_of = solids_of(*program);
        const auto stateless = kernel::Program::compile(opaque(scene));
        const std::vector<std::int32_t> opaque_solid_of = solids_of(*stateless);
        for (int i = 0; i < rays_per_scene; ++i) {
            const Vec3 start = (maker.place() - center) + (6 * maker.scale()) * direction(rng);
            const Vec3 target = (maker.place() - center) + maker.scale() * direction(rng);
            const Vec3 dir = normalized(target - start);
            const Truth truth(scene, {quad(start) + quad(center), quad(dir)});
            if (truth.grazes()) {
                ++walks.grazing;
                continue;
            }
            const std::vector<Change> want = truth.changes();
            ++walks.rays;
            walks.changes += want.size() - 1;
            // Places are 1e9 radii away at most, where they have 7 digits left.
            walks.wrong +=
                !agree(walk(program->tables(), solid_of, start, dir), want, 1e-6 * maker.scale());
            if (!stateless->tables().stateful && want[0].filler == none) {
                ++walks.entries;
                walks.wrong_entries +=
                    !first_is_found(stateless->tables(), opaque_solid_of, start, dir, want);
            }
        }
    }
    return walks;
}

} // namespace

const std::vector<SolidRegime>& solid_regimes() {
    static const std::vector<SolidRegime> regimes{
        {"random trees, 1e-9 to 1e9, up to 1e9 away", run<Kin::unrelated>},
        {"half of the surfaces twice", run<Kin::same>},
        {"half of them twice but for 1e-12 to 1e-9", run<Kin::nearly_same>},
        {"shells, walls of 1e-12 to 1e-3", run<Kin::shells>},
    };
    return regimes;
}

} // namespace fraja::stress
