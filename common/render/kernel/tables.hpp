// What a kernel reads: a scene as flat tables, the same for every instruction set.
//
// Plain data, built once by program.cpp and then never changed. Places are relative to
// Tables::center, so that a small scene far from the world's origin keeps its digits.
#pragma once

#include "common/render/ray_counts.hpp"
#include "common/render/sample_limits.hpp"

#include <cstddef>
#include <cstdint>

namespace fraja::kernel {

/// No leaf, no surface.
inline constexpr std::int32_t none = -1;

// ---------------------------------------------------------------------------------- the surfaces
//
// A surface divides space in an inside and an outside. Forms that are the same set of points share
// one, so that coincident surfaces are crossed at one instant, whatever rounding does.

enum class SurfaceKind : std::uint8_t { sphere, plane, cylinder, cone };
inline constexpr std::size_t surface_kinds = 4;

struct SphereSurface {
    double center[3], radius; ///< radius >= 0
};
struct PlaneSurface {
    double normal[3];    ///< unit; outside is where it points to
    double distance;     ///< normal . point
    double direction[3]; ///< of the normal, as the scene gives it
    double point[3];     ///< of the plane, as the scene gives it
};
struct CylinderSurface {
    double origin[3], axis[3], radius; ///< axis unit, radius >= 0
    double direction[3];               ///< of the axis, as the scene gives it
    double direction_squared[2];       ///< high and low part
};
struct ConeSurface {
    double origin[3], axis[3]; ///< the tip; unit
    double slope;              ///< tangent of the angle between axis and surface, >= 0
    double slope_squared;
    double direction[3];     ///< of the axis, as the scene gives it
    double scaled_cosine[2]; ///< |direction|^2 cos^2 of that angle: high and low part
};

// ----------------------------------------------------------------------------------- many spheres
//
// Opaque spheres, each a solid of its own, that no ray can be inside of, stand apart when there are
// many: in a hierarchy of boxes. Their boxes are floats, rounded outwards.

inline constexpr std::size_t bvh_width = 8;
/// Boxes within boxes, at most.
inline constexpr std::size_t bvh_levels_max = 96;
/// Boxes that wait while a ray looks into the nearest.
inline constexpr std::size_t bvh_stack_max = (bvh_width - 1) * bvh_levels_max + 1;

struct alignas(64) BvhNode {
    float low[3][bvh_width], high[3][bvh_width]; ///< by axis; an empty box for no child
    /// A node; of leaves the complement of (first sphere * 8 + spheres - 1).
    std::int32_t child[bvh_width];
};

// --------------------------------------------------------------------------------- leaves, patches

/// What a leaf is made of: a formula over the sides of surfaces, as a tree.
struct Node {
    enum class Kind : std::uint8_t { never, always, literal, all, any };
    Kind kind = Kind::never;
    bool negated = false;    ///< of a literal: true outside the surface
    std::uint32_t first = 0; ///< of a literal the surface; else the first of its parts
    std::uint32_t count = 0; ///< parts, one after the other
};

/// A basic solid in its place in the tree of aggregates.
struct Leaf {
    Node root;
    double refractive_index;
    double center[3], radius; ///< of a sphere around it; radius infinite where there is none
    std::uint32_t surface_begin, surface_count; ///< what it is made of, in leaf_surfaces
};

/// A surface as part of a leaf.
struct Patch {
    std::uint32_t leaf, surface;
    bool flipped; ///< the leaf lies outside the surface
    std::uint32_t material_in, material_out;
};

struct Material {
    enum class Pattern : std::uint8_t { plain, damier, hamier, mamier };
    Pattern pattern = Pattern::plain;
    double kd[3], kd_two[3]; ///< kd_two: the other fields of a chequer
    double krl[3], krg[3], ktg[3];
    std::int32_t ns;
    double step, x, y; ///< of a chequer, world space
    bool lit;          ///< lights show on it: kd or krl is not black
    bool shiny;        ///< krl is not black
    bool mirror;       ///< krg is not black
    bool glass;        ///< ktg is not black
};

struct Light {
    bool point;          ///< else from a direction
    double to[3];        ///< its place; or the unit vector towards it
    double rgb[3];       ///< not black
    std::int32_t within; ///< the leaf that fills its place; none, also where unknown
    bool within_known;
};

struct CameraTable {
    double origin[3];
    double direction[3]; ///< unit; where the screen's place is the eye's
    double top_left[3], rightwards[3], downwards[3];
    bool stereo;
    double to_left_eye[3];
};

// ------------------------------------------------------------------------------------- the scene

struct Tables {
    std::uint64_t scene; ///< a number that no other compiled scene of this process has
    double center[3];    ///< world space; subtracted from every place below

    const SphereSurface* spheres;
    const PlaneSurface* planes;
    const CylinderSurface* cylinders;
    const ConeSurface* cones;
    std::uint32_t sphere_count, plane_count, cylinder_count, cone_count;
    /// Surfaces are numbered spheres first, then planes, cylinders, cones.
    std::uint32_t surface_count;

    const Leaf* leaves;
    std::uint32_t leaf_count;
    const Node* nodes;
    const std::uint32_t* leaf_surfaces;
    /// The leaf that is the inside of a surface, by surface; none.
    const std::int32_t* leaf_of_surface;
    /// The key of a hit where that leaf is entered: twice the patch.
    const std::uint32_t* entry_keys;
    /// The others.
    const std::uint32_t* composite_leaves;
    std::uint32_t composite_leaf_count;
    /// By surface: a composite leaf is made of it.
    const bool* in_composite;

    const Patch* patches;
    const std::uint32_t* users; ///< patches by surface: users[user_begin[s] .. user_begin[s + 1])
    const std::uint32_t* user_begin;

    /// Bits by leaf m: the leaves that show when entered where m fills the space.
    /// Row m starts at shows_in[m * leaf_words].
    const std::uint64_t* shows_in;
    /// Likewise: the leaves that m displaces.
    const std::uint64_t* displaced_by;

    bool leaf_is_surface; ///< leaf n is the inside of surface n, for all n
    bool any_relations;   ///< some leaf displaces another
    bool all_relations;   ///< of each two leaves one displaces the other, or there is but one
    bool shared_surfaces; ///< some surface is part of two leaves
    std::uint32_t surface_words, leaf_words; ///< of 64 bits each

    const BvhNode* bvh; ///< the root; null without
    const SphereSurface* bvh_spheres;
    const std::uint32_t* bvh_materials; ///< of each sphere's outside
    std::uint32_t bvh_sphere_count;     ///< their surfaces are numbered on from surface_count

    const Material* materials;
    std::uint32_t material_count;
    const Light* lights;
    std::uint32_t light_count;
    double ambient[3], background[3];
    bool any_ambient; ///< it is not black
    double ambient_index;
    CameraTable camera;

    /// A ray may be inside something: rays carry a bit per surface, and the leaf that fills the
    /// space they start in. Else every ray is outside every leaf.
    bool stateful;
    bool camera_is_outside; ///< no camera ray starts in a leaf
};

// -------------------------------------------------------------------------------------- the work

/// How samples are drawn.
struct SampleJob {
    std::uint32_t depth;
    double cut[3];
};

/// Places on the screen, and what is seen there.
struct Block {
    std::uint32_t count;  ///< of samples, 1 .. block_samples_max
    const double *x, *y;  ///< from the top left, 0 to 1, or somewhat beside
    double* rgb;          ///< three to a sample
    double* lost;         ///< likewise: the weight of rays not followed; null: not asked for
    double* cut;          ///< likewise: of those below the cut level alone
    std::uint64_t* paths; ///< what a sample met, as a number; null: not asked for
    std::uint32_t* rays;  ///< that it took
};

/// What the ray of a sample meets first.
struct TableHit {
    double place[3], normal[3]; ///< relative to Tables::center; unit, out of the leaf
    /// The leaf; of spheres apart leaf_count and the sphere's number; none.
    std::int64_t what;
};

/// Places on the screen, as in Block, and what stands there.
struct FirstHits {
    std::uint32_t count;
    const double *x, *y;
    TableHit* hits;
};

/// What the kernel asks of and tells its owner while it works.
struct DrawControl {
    void* owner;
    /// Rays traced since the last call; answers whether to go on.
    bool (*report)(void* owner, std::uint64_t rays);
};

enum class BlockEnd : std::uint8_t { drawn, stopped, unresolved_overlap };

inline constexpr std::size_t overlapping_max = 64;

struct BlockResult {
    BlockEnd end = BlockEnd::drawn;
    RayCounts counts;          ///< but for pixels
    bool skipped = false;      ///< nothing was searched for: background, or one plane
    bool budget_spent = false; ///< a sample needs more than rays_per_sample_max
    /// Leaves that a ray was in, of which none displaces all others; the first ones, if many.
    std::uint32_t overlapping[overlapping_max] = {};
    std::uint32_t overlapping_count = 0;
};

/// Rays to be traced for measuring: columns, padded to a multiple of 16.
struct RayBatch {
    std::size_t count;
    const double *origin[3], *dir[3];
    double* t;             ///< the limit, then the hit
    std::int64_t* surface; ///< that they start on; then that they hit (0 for any hit), or none
    bool any_hit;          ///< as shadow rays
};

/// What a kernel can draw. What it has not is not compiled into it.
struct Features {
    bool state;      ///< rays may be inside something: Tables::stateful
    bool composites; ///< leaves of several surfaces, or the reverse: not leaf_is_surface
    bool apart;      ///< spheres in a hierarchy: Tables::bvh
    friend bool operator==(const Features&, const Features&) = default;
};

/// An instruction set's kernels.
struct KernelEntry {
    const char* isa;
    BlockResult (*draw_block)(const Tables&, const SampleJob&, const Block&, const DrawControl&);
    BlockResult (*find_first_hits)(const Tables&, const FirstHits&, const DrawControl&);
    Features (*features_for)(const Tables&); ///< of the one that draws a scene
    void (*find_hits)(const Tables&, const RayBatch&);
};

} // namespace fraja::kernel
