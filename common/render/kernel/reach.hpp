// What no ray can reach: a kernel need not hold it.
#pragma once

#include "common/render/kernel/bounds.hpp"
#include "common/render/kernel/materials.hpp"
#include "common/render/kernel/solids.hpp"
#include "common/render/kernel/tables.hpp"

#include <functional>
#include <vector>

namespace fraja::kernel {

/// Pairs of a sphere that stands apart and a leaf that might hide it which are worth being looked
/// at.
inline constexpr std::size_t hidden_pairs_max = std::size_t{1} << 24;

/// A solid is hidden within an opaque one that no ray can be in. Where there are only camera rays
/// (no lights, mirrors, glass), what lies beside the picture is hidden as well.
class Reach {
public:
    struct Scene {
        const std::vector<SolidLeaf>& leaves; ///< surfaces have numbers of Tables
        const SurfaceCollector::Sorted& surfaces;
        const Materials& materials;
        const CameraTable& camera;
        const std::vector<BoundingSphere>& starts; ///< around the places where camera rays start
        bool any_lights;
        std::function<bool(std::size_t, std::size_t)> displaces; ///< of leaves, by number
    };
    explicit Reach(const Scene& scene);

    /// No camera ray starts in a leaf.
    [[nodiscard]] bool camera_is_outside() const { return camera_is_outside_; }
    [[nodiscard]] std::vector<bool> hidden_leaves() const;
    [[nodiscard]] std::vector<bool> hidden_spheres(const std::vector<SphereSurface>& spheres) const;
    /// Whether the surface of a sphere may lie partly within a leaf that rays can be in.
    [[nodiscard]] bool meets_glass(const SphereSurface& sphere) const;

private:
    void find_glass();
    void find_covers();
    /// What the leaf's formula is at all these places.
    [[nodiscard]] Holds holds(std::size_t leaf, const BoundingSphere& places) const;
    [[nodiscard]] std::vector<bool> hidden(const std::vector<BoundingSphere>& solids) const;

    const Scene& scene_;
    std::vector<BoundingSphere> bounds_; ///< by leaf
    // All leaves, by number.
    std::vector<std::size_t> enterable_; ///< rays can be in them
    std::vector<std::size_t> covers_;    ///< opaque; no ray can
    std::vector<std::size_t> glass_;     ///< no ray can, since it lies within a cover
    bool camera_is_outside_ = true;
    bool only_camera_rays_ = false;
};

} // namespace fraja::kernel
