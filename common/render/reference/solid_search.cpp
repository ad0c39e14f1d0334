#include "common/render/reference/solid_search.hpp"

#include "common/render/overlap_message.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace fraja::reference {

/// Buffers for as long as an Aggregate is searched; its members that are Aggregates lease their
/// own.
class SolidSearch::ScratchLease {
public:
    explicit ScratchLease(SolidSearch& search) : search_(search) {
        if (search.leased_ == search.scratch_.size())
            search.scratch_.emplace_back();
        scratch_ = &search.scratch_[search.leased_++];
        scratch_->hits.clear();
        scratch_->inside.clear();
    }
    ~ScratchLease() { --search_.leased_; }
    ScratchLease(const ScratchLease&) = delete;
    ScratchLease& operator=(const ScratchLease&) = delete;
    Scratch& operator*() { return *scratch_; }
    Scratch* operator->() { return scratch_; }

private:
    SolidSearch& search_;
    Scratch* scratch_;
};

std::optional<SolidHit> SolidSearch::first_hit(SolidIndex index, const Ray& ray) {
    const PreparedSolid& solid = model_.solids[as_size(index)];
    auto hit = std::visit([&](const auto& s) { return first_hit_of(s, ray); }, solid);
    if (hit && std::holds_alternative<BasicSolid>(solid))
        hit->solid = index;
    return hit;
}

bool SolidSearch::contains(SolidIndex index, const Point& p, Border border) {
    return std::visit([&](const auto& solid) { return contained_in(solid, p, border); },
                      model_.solids[as_size(index)]);
}

bool SolidSearch::blocks(SolidIndex index, const Ray& ray, double distance) {
    return std::visit([&](const auto& solid) { return blocked_by(solid, ray, distance); },
                      model_.solids[as_size(index)]);
}

double SolidSearch::refractive_index(const std::optional<Volume>& volume, const Point& p) {
    const auto index_here = [&](const Volume& v) {
        return std::visit([&](const auto& kind) { return index_of(kind, p); }, v);
    };
    if (volume)
        if (const std::optional<double> index = index_here(*volume))
            return *index;
    return index_here(model_.scene->world.ambient_volume).value_or(1.0);
}

std::optional<double> SolidSearch::index_of(const IsotropicVolume& volume, const Point&) {
    return volume.refractive_index;
}

/// Of a BasicSolid the index of its volume, wherever the point is; of an Aggregate that of the
/// member that fills the point, if any.
std::optional<double> SolidSearch::index_of(SolidIndex index, const Point& p) {
    // A loop, not a recursion: volumes may refer to solids whose volumes refer to solids, and so
    // on.
    while (const auto* basic = std::get_if<BasicSolid>(&model_.solids[as_size(index)])) {
        if (const auto* volume = std::get_if<IsotropicVolume>(&basic->volume))
            return volume->refractive_index;
        index = std::get<SolidIndex>(basic->volume);
    }
    const auto& aggregate = std::get<PreparedAggregate>(model_.solids[as_size(index)]);
    ScratchLease scratch(*this);
    for (const SolidIndex member : aggregate.members)
        if (contains(member, p, Border::counts))
            scratch->inside.push_back(member);
    const std::optional<SolidIndex> filler = main_of(aggregate, scratch->inside);
    return filler ? index_of(*filler, p) : std::nullopt;
}

// ------------------------------------------------------------------------------------ BasicSolid

std::optional<SolidHit> SolidSearch::first_hit_of(const BasicSolid& solid, const Ray& ray) {
    const std::optional<SurfaceHit> hit = forms_.first_hit(solid.textured_form, ray);
    return hit ? std::optional(SolidHit{*hit, solid.volume, std::nullopt}) : std::nullopt;
}

bool SolidSearch::contained_in(const BasicSolid& solid, const Point& p, Border border) {
    return forms_.contains(solid.textured_form, p, border);
}

bool SolidSearch::blocked_by(const BasicSolid& solid, const Ray& ray, double distance) {
    return forms_.blocks(solid.textured_form, ray, distance);
}

// ------------------------------------------------------------------------------------- Aggregate

bool SolidSearch::contained_in(const PreparedAggregate& aggregate, const Point& p, Border border) {
    return std::any_of(aggregate.members.begin(), aggregate.members.end(),
                       [&](SolidIndex member) { return contains(member, p, border); });
}

bool SolidSearch::blocked_by(const PreparedAggregate& aggregate, const Ray& ray, double distance) {
    const std::optional<SolidHit> hit = first_hit_of(aggregate, ray);
    return hit &&
           std::sqrt(distance_squared(hit->surface.point.position, ray.start.position)) < distance;
}

std::optional<SolidHit> SolidSearch::first_hit_of(const PreparedAggregate& aggregate,
                                                  const Ray& ray) {
    ScratchLease scratch(*this);
    meet_members(aggregate, ray, *scratch);
    if (scratch->hits.empty() || interrupt_.raised())
        return std::nullopt;

    // Equal distances, arbitrary in Raja, keep the order of the members.
    const MemberHit& f = *std::min_element(scratch->hits.begin(), scratch->hits.end(),
                                           [](const MemberHit& a, const MemberHit& b) {
                                               return a.distance_squared < b.distance_squared;
                                           });
    for (const SolidIndex member : aggregate.members)
        if (contains(member, f.hit.surface.point, Border::does_not_count) ||
            (member == f.member && dot(ray.dir, f.hit.surface.normal) > 0))
            scratch->inside.push_back(member);
    if (scratch->inside.empty()) // a solid is entered from outside
        return f.hit;

    return first_visible(aggregate, *scratch);
}

void SolidSearch::meet_members(const PreparedAggregate& aggregate, const Ray& ray,
                               Scratch& scratch) {
    for (const SolidIndex member : aggregate.members)
        if (const std::optional<SolidHit> hit = first_hit(member, ray)) {
            const double d = distance_squared(hit->surface.point.position, ray.start.position);
            scratch.hits.push_back({member, d, *hit});
        }
}

void SolidSearch::sort_by_distance(Scratch& scratch) {
    scratch.by_distance.resize(scratch.hits.size());
    std::iota(scratch.by_distance.begin(), scratch.by_distance.end(), 0u);
    std::sort(scratch.by_distance.begin(), scratch.by_distance.end(),
              [&](std::uint32_t a, std::uint32_t b) {
                  const double da = scratch.hits[a].distance_squared;
                  const double db = scratch.hits[b].distance_squared;
                  return da != db ? da < db : a < b;
              });
}

/// Of the hits, in order of distance, the first at which what fills the space changes.
std::optional<SolidHit> SolidSearch::first_visible(const PreparedAggregate& aggregate,
                                                   Scratch& scratch) {
    const std::optional<SolidIndex> main = main_of(aggregate, scratch.inside);
    if (!main)
        return std::nullopt;
    const Priorities& priorities = aggregate.priorities;
    sort_by_distance(scratch);
    for (const std::uint32_t nth : scratch.by_distance) {
        MemberHit& met = scratch.hits[nth];
        if (met.member == *main) { // left, or its own inner surface is met
            if (!met.hit.outer)
                met.hit.outer = volume_beyond(aggregate, scratch, met);
            return met.hit;
        }
        if (priorities.above(met.member, *main)) { // entered
            if (!met.hit.outer) // else a nested Aggregate knows better; an error in Raja
                met.hit.outer = *main;
            return met.hit;
        }
        if (priorities.above(*main, met.member)) // entered unseen
            scratch.inside.push_back(met.member);
        // Without a relation to main the hit is skipped, as Raja's class files do.
    }
    return std::nullopt;
}

std::optional<Volume> SolidSearch::volume_beyond(const PreparedAggregate& aggregate,
                                                 Scratch& scratch, const MemberHit& left) {
    std::erase_if(scratch.inside, [&](SolidIndex member) {
        return member == left.member ||
               !contains(member, left.hit.surface.point, Border::does_not_count);
    });
    const std::optional<SolidIndex> main = main_of(aggregate, scratch.inside);
    return main ? std::optional<Volume>(*main) : std::nullopt;
}

/// The solid of a set that has priority over each of the others. None, and an unresolved_overlap,
/// when no solid has; none when the set is empty.
std::optional<SolidIndex> SolidSearch::main_of(const PreparedAggregate& aggregate,
                                               std::span<const SolidIndex> set) {
    const auto above_all = [&](SolidIndex a) {
        return std::all_of(set.begin(), set.end(), [&](SolidIndex b) {
            return a == b || aggregate.priorities.above(a, b);
        });
    };
    const auto main = std::find_if(set.begin(), set.end(), above_all);
    if (main != set.end())
        return *main;
    if (!set.empty() && !interrupt_.raised())
        interrupt_.raise(ErrorCode::unresolved_overlap,
                         overlap_message(*model_.scene, aggregate.priorities, set));
    return std::nullopt;
}

} // namespace fraja::reference
