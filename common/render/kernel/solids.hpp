// The basic solids of a scene in their places, and which of them shows where they overlap.
#pragma once

#include "common/render/kernel/expression.hpp"
#include "common/render/kernel/surfaces.hpp"
#include "common/render/priorities.hpp"
#include "common/scene/scene.hpp"

#include <cstdint>
#include <functional>
#include <optional>
#include <set>
#include <vector>

namespace fraja::kernel {

/// A primitive form's surface within a leaf.
struct LeafSurface {
    Side side; ///< what of the surface the leaf is made of
    TextureIndex texture_in{}, texture_out{};
};

/// A basic solid in its place: through which aggregates, as which members.
struct SolidLeaf {
    struct Step {
        std::uint32_t aggregate; ///< a number of its place, not of its solid
        SolidIndex member;
    };
    SolidIndex solid{};
    std::vector<Step> path; ///< from the world's solid down
    Expression inside;
    std::vector<LeafSurface> surfaces; ///< in the order of the scene
    double refractive_index = 1;
};

/// A solid that is one opaque sphere, that no ray can be inside of, and that no priority is about.
struct SphereApart {
    Sphere sphere; ///< world space
    TextureIndex texture{};
    SolidIndex solid{};
};

/// How much a scene may hold to be drawn with rays that carry a bit per surface.
struct SolidLimits {
    std::size_t leaves = 4096;
    std::size_t surfaces = 4096;
    std::size_t leaf_surfaces = 65536; ///< of all leaves together
    // Spheres apart do not count.
    std::size_t spheres_apart_min = 24;                   ///< fewer are not worth a hierarchy
    std::size_t spheres_apart_max = std::size_t{1} << 28; ///< as BvhNode can number them
};

/// The leaves of a scene. Surfaces have numbers of collection.
class SolidCollector {
public:
    /// Solids of `listed` do not stand apart.
    SolidCollector(const Scene& scene, const SolidLimits& limits,
                   const std::set<SolidIndex>& listed, SurfaceCollector& surfaces)
        : scene_(scene), limits_(limits), listed_(listed), surfaces_(surfaces) {}

    /// Nothing when the scene is beyond the limits or has a volume that is an aggregate.
    /// `is_outside(sphere)` answers whether no camera ray starts within it.
    [[nodiscard]] std::optional<std::vector<SolidLeaf>>
    collect(const std::function<bool(const Sphere&)>& is_outside);
    /// Of the last collect(), taken out.
    [[nodiscard]] std::vector<SphereApart> take_spheres_apart() { return std::move(apart_); }

    /// Whether a scene's author put the member that holds `a` above the one that holds `b`, where
    /// their ways part. Of the leaves of the last collect().
    [[nodiscard]] bool displaces(const SolidLeaf& a, const SolidLeaf& b) const;
    [[nodiscard]] bool any_priorities() const { return any_priorities_; }
    /// For a message: the two members, and their priorities, where the ways of two leaves part.
    struct Parting {
        const Priorities& priorities;
        SolidIndex a, b;
    };
    [[nodiscard]] Parting parting(const SolidLeaf& a, const SolidLeaf& b) const;

private:
    void find_named();
    void find_spheres_apart(const std::function<bool(const Sphere&)>& is_outside);
    [[nodiscard]] const BasicTexturedForm* lone_opaque_sphere(const BasicSolid& solid) const;
    bool collect(SolidIndex index);
    bool collect(const BasicSolid& solid, SolidIndex index);
    bool collect(const Aggregate& aggregate);
    Expression expression(TexturedFormIndex index, bool complement);

    const Scene& scene_;
    SolidLimits limits_;
    std::set<SolidIndex> listed_;
    SurfaceCollector& surfaces_;
    std::vector<SolidLeaf> leaves_;
    std::vector<bool> is_named_; ///< by solid: some priority is about it
    std::size_t named_on_path_ = 0;
    std::vector<bool> is_apart_; ///< by solid; empty when there are too few
    std::vector<SphereApart> apart_;
    std::vector<SolidLeaf::Step> path_;
    std::vector<LeafSurface> leaf_surfaces_; ///< of the leaf at work
    std::size_t leaf_surface_count_ = 0;
    std::vector<Priorities> priorities_; ///< by place of aggregate
    bool any_priorities_ = false;
};

/// The index of a volume that has the same everywhere; nothing when it is an aggregate's.
[[nodiscard]] std::optional<double> refractive_index(const Scene& scene, const Volume& volume);

} // namespace fraja::kernel
