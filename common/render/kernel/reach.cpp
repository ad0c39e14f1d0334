#include "common/render/kernel/reach.hpp"

#include "common/render/kernel/beam.hpp"
#include "common/render/kernel/triples.hpp"

#include <algorithm>

namespace fraja::kernel {
namespace {

/// Larger by more than rounding can have taken away.
BoundingSphere around(const SphereSurface& sphere) {
    const Vec3 center = vec(sphere.center);
    return {center, sphere.radius + 1e-9 * (sphere.radius + length(center))};
}

} // namespace

Reach::Reach(const Scene& scene) : scene_(scene) {
    for (const SolidLeaf& leaf : scene.leaves)
        bounds_.push_back(bounding_sphere(leaf.inside, scene.surfaces));
    only_camera_rays_ = !scene.any_lights &&
                        std::ranges::none_of(scene.materials.table,
                                             [](const Material& m) { return m.mirror || m.glass; });
    find_glass();
    find_covers();
}

void Reach::find_glass() {
    for (std::size_t i = 0; i < scene_.leaves.size(); ++i) {
        const bool starts_outside =
            std::ranges::all_of(scene_.starts, [&](const BoundingSphere& places) {
                return holds(i, places) == Holds::never;
            });
        camera_is_outside_ &= starts_outside;
        const bool glass =
            std::ranges::any_of(scene_.leaves[i].surfaces, [&](const LeafSurface& s) {
                return scene_.materials.table[scene_.materials[s.texture_out]].glass;
            });
        (glass || !starts_outside ? glass_ : covers_).push_back(i);
    }
}

/// Takes from the opaque leaves those that rays can be in after all. They get into glass, unless it
/// lies within an opaque leaf that they cannot be in; and from where they are into an opaque leaf
/// that does not displace it: where glass ends that had displaced it, or had nothing to do with it.
void Reach::find_covers() {
    const auto take = [&](std::vector<std::size_t>& from, const auto& is_entered) {
        const auto entered = std::stable_partition(
            from.begin(), from.end(), [&](std::size_t leaf) { return !is_entered(leaf); });
        const bool any = entered != from.end();
        enterable_.insert(enterable_.end(), entered, from.end());
        from.erase(entered, from.end());
        return any;
    };
    const auto reached_from_outside = [&](std::size_t glass) {
        return std::ranges::none_of(covers_, [&](std::size_t cover) {
            return holds(cover, bounds_[glass]) == Holds::always;
        });
    };
    const auto reached_from_within = [&](std::size_t leaf) {
        return std::ranges::any_of(enterable_, [&](std::size_t from) {
            return !scene_.displaces(leaf, from) && holds(leaf, bounds_[from]) != Holds::never;
        });
    };
    for (bool any = true; any;) {
        const bool glass = take(glass_, reached_from_outside);
        any = take(covers_, reached_from_within) || glass;
    }
}

Holds Reach::holds(std::size_t leaf, const BoundingSphere& places) const {
    return holds_throughout(places, scene_.leaves[leaf].inside, scene_.surfaces);
}

std::vector<bool> Reach::hidden(const std::vector<BoundingSphere>& solids) const {
    Beam picture;
    const bool see_picture = only_camera_rays_ && camera_is_outside_ &&
                             beam_through(scene_.camera, {0, 1}, {0, 1}, picture);
    const auto beside_the_picture = [&](const BoundingSphere& bounds) {
        double center[3];
        put(center, bounds.center);
        return see_picture && picture.misses(center, bounds.radius);
    };
    const auto covered = [&](const BoundingSphere& bounds) {
        return std::ranges::any_of(
            covers_, [&](std::size_t cover) { return holds(cover, bounds) == Holds::always; });
    };
    std::vector<bool> hidden;
    hidden.reserve(solids.size());
    for (const BoundingSphere& bounds : solids)
        hidden.push_back(bounds.radius < 0 || beside_the_picture(bounds) || covered(bounds));
    return hidden;
}

std::vector<bool> Reach::hidden_leaves() const {
    return hidden(bounds_);
}

std::vector<bool> Reach::hidden_spheres(const std::vector<SphereSurface>& spheres) const {
    if (covers_.size() * spheres.size() > hidden_pairs_max)
        return std::vector<bool>(spheres.size(), false);
    std::vector<BoundingSphere> bounds;
    bounds.reserve(spheres.size());
    for (const SphereSurface& sphere : spheres)
        bounds.push_back(around(sphere));
    return hidden(bounds);
}

bool Reach::meets_glass(const SphereSurface& sphere) const {
    const BoundingSphere places = around(sphere);
    return std::ranges::any_of(enterable_, [&](std::size_t leaf) {
        const BoundingSphere& bounds = bounds_[leaf];
        return length(bounds.center - places.center) <= bounds.radius + places.radius &&
               holds(leaf, places) == Holds::sometimes;
    });
}

} // namespace fraja::kernel
