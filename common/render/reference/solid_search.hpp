// Solids: what fills the space where they overlap. FORMAT.md, sections 8.5 and 8.6.
#pragma once

#include "common/render/reference/csg_search.hpp"

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <vector>

namespace fraja::reference {

/// Where a ray meets a solid.
struct SolidHit {
    SurfaceHit surface;
    Volume inner;                ///< behind the surface, against its normal
    std::optional<Volume> outer; ///< before it; nothing: the world's ambient volume
    SolidIndex solid{};          ///< the basic one whose surface it is
};

/// Asks what a ray meets among a model's solids. A ray that needs a priority the scene does not
/// give raises unresolved_overlap. Otherwise as CsgSearch.
class SolidSearch {
public:
    SolidSearch(const Model& model, Interrupt& interrupt)
        : model_(model), interrupt_(interrupt), forms_(model, interrupt) {}

    [[nodiscard]] std::optional<SolidHit> first_hit(SolidIndex, const Ray&);
    [[nodiscard]] bool contains(SolidIndex, const Point&, Border);
    /// Whether light on its way along the ray is stopped nearer than `distance`.
    [[nodiscard]] bool blocks(SolidIndex, const Ray&, double distance);
    /// The index of a volume at a point; of no volume, that of the world's ambient one; 1 when that
    /// is a solid elsewhere.
    [[nodiscard]] double refractive_index(const std::optional<Volume>&, const Point&);

private:
    struct MemberHit {
        SolidIndex member;
        double distance_squared;
        SolidHit hit;
    };
    /// What one level of nested Aggregates works with, kept for the next ray.
    struct Scratch {
        std::vector<MemberHit> hits;            ///< in the order of the members
        std::vector<std::uint32_t> by_distance; ///< the hits, nearest first
        std::vector<SolidIndex> inside;         ///< the solids the ray is in
    };
    class ScratchLease;

    std::optional<SolidHit> first_hit_of(const BasicSolid&, const Ray&);
    std::optional<SolidHit> first_hit_of(const PreparedAggregate&, const Ray&);
    bool contained_in(const BasicSolid&, const Point&, Border);
    bool contained_in(const PreparedAggregate&, const Point&, Border);
    bool blocked_by(const BasicSolid&, const Ray&, double distance);
    bool blocked_by(const PreparedAggregate&, const Ray&, double distance);
    std::optional<double> index_of(const IsotropicVolume&, const Point&);
    std::optional<double> index_of(SolidIndex, const Point&);

    /// Fills scratch.hits.
    void meet_members(const PreparedAggregate&, const Ray&, Scratch&);
    /// Fills scratch.by_distance; of equal distances the first member is first.
    static void sort_by_distance(Scratch&);
    std::optional<SolidHit> first_visible(const PreparedAggregate&, Scratch&);
    std::optional<Volume> volume_beyond(const PreparedAggregate&, Scratch&, const MemberHit& left);
    std::optional<SolidIndex> main_of(const PreparedAggregate&, std::span<const SolidIndex> set);

    const Model& model_;
    Interrupt& interrupt_;
    CsgSearch forms_;
    std::deque<Scratch> scratch_; // a deque: what is leased stays where it is as it grows
    std::size_t leased_ = 0;
};

} // namespace fraja::reference
