// A scene made into tables.
#pragma once

#include "common/render/kernel/bounds.hpp"
#include "common/render/kernel/bvh.hpp"
#include "common/render/kernel/materials.hpp"
#include "common/render/kernel/solids.hpp"
#include "common/render/kernel/tables.hpp"
#include "common/scene/scene.hpp"

#include <memory>
#include <set>
#include <span>
#include <string>
#include <vector>

namespace fraja::kernel {

/// What it takes to draw a scene. Does not move: tables() points into it.
class Program {
public:
    /// Nothing for the rare scene that is beyond SolidLimits or has an aggregate as a volume.
    [[nodiscard]] static std::unique_ptr<const Program> compile(const Scene& scene,
                                                                const SolidLimits& limits = {});
    Program(const Program&) = delete;
    Program& operator=(const Program&) = delete;

    [[nodiscard]] const Tables& tables() const { return tables_; }
    /// The basic solids that the leaves of the tables are.
    [[nodiscard]] std::vector<SolidIndex> solids() const;
    /// The basic solid that a hit is on; of TableHit::what, which must not be none.
    [[nodiscard]] SolidIndex solid_of(std::int64_t what) const;
    /// What to tell the scene's author about leaves (two at least) that overlap, of which none
    /// displaces all others.
    [[nodiscard]] std::string overlap_message(const Scene& scene,
                                              std::span<const std::uint32_t> leaves) const;

private:
    Program(const Scene& scene, const SolidLimits& limits, const std::set<SolidIndex>& listed,
            const Vec3& center);
    /// What there is; false for what compile() gives nothing for.
    bool collect(const Scene& scene);
    /// The tables, of what is left.
    void build();

    [[nodiscard]] std::vector<BoundingSphere> screen() const;
    void add_surfaces();
    std::vector<SolidIndex> leave_out_hidden(const SolidLimits& limits);
    void sort_leaves();
    void build_hierarchy();
    void add_leaves();
    void add_leaf(const SolidLeaf& leaf);
    Node node_of(const Expression& e);
    void add_relations();
    void add_lights(const Scene& scene);
    void find_filler(Light& light) const;
    void add_camera(const Scene& scene);
    void find_features();
    void point_tables();

    SurfaceCollector collector_;
    SolidCollector solids_;
    std::vector<SolidLeaf> solid_leaves_;
    std::vector<SphereApart> spheres_apart_;    ///< until their hierarchy is built
    std::vector<SphereSurface> apart_surfaces_; ///< likewise

    Bvh bvh_;
    std::vector<SphereSurface> bvh_spheres_;
    std::vector<std::uint32_t> bvh_materials_;
    std::vector<SolidIndex> bvh_solids_;
    SurfaceCollector::Sorted surfaces_;
    std::vector<Leaf> leaves_;
    std::vector<Node> nodes_;
    std::vector<std::uint32_t> leaf_surfaces_;
    std::vector<std::int32_t> leaf_of_surface_;
    std::vector<std::uint32_t> entry_keys_, composite_leaves_;
    std::unique_ptr<bool[]> in_composite_;
    std::vector<Patch> patches_;
    std::vector<std::uint32_t> users_, user_begin_;
    std::vector<std::uint64_t> relations_;
    Materials materials_;
    std::vector<Light> lights_;
    Tables tables_{};
};

} // namespace fraja::kernel
