// What the rays of a wave meet.
#pragma once

#include "common/render/kernel/tracer.hpp"

#include <algorithm>
#include <numeric>

namespace fraja::kernel {
namespace {

template <Features has>
inline void BlockTracer<has>::trace() {
    const std::size_t n = wave_.rays.size();
    keys_.resize(n + packet_rays);
    sides_.resize(n + packet_rays, {none, none});
    spheres_met_.resize(n + packet_rays);
    if (wave_.depth < job_.depth) {
        walker_.look_at_all();
        spheres_in_view_ = apart();
    } else if (view_ == View::one_plane) {
        return meet_plane(plane_in_view_);
    }
    Packet packet;
    for (std::size_t i = 0; i < n && going_on(); i += packet_rays) {
        trace_packet(i, packet);
        report(std::min<std::size_t>(packet_rays, n - i));
    }
    result_.counts.form_tests += std::uint64_t{n} * walker_.surfaces_in_view();
}

template <Features has>
inline void BlockTracer<has>::trace_packet(std::size_t i, Packet& packet) {
    if constexpr (has.state)
        if (tables_.stateful)
            return trace_stateful(i, packet);
    trace_stateless(i, packet);
}

inline unsigned packet_mask(std::size_t rays) {
    return rays >= packet_rays ? (1u << packet_rays) - 1 : (1u << rays) - 1;
}

template <Features has>
inline void BlockTracer<has>::trace_stateless(std::size_t i, Packet& packet) {
    RayQueue& rays = wave_.rays;
    for (std::size_t g = 0; g < packet_groups; ++g) {
        packet.rays[g] = rays.rays_at(i + g * lanes);
        const Walker::Found found = walker_.first_entry<has.composites>(packet.rays[g], never());
        packet.t[g] = found.t;
        packet.surface[g] =
            select(found.surface < 0, all_lanes(std::int64_t{none}), all_lanes(leaf_instead));
        for (int lane = 0; lane < lanes; ++lane) {
            const std::int64_t surface = found.surface[lane];
            std::uint32_t& key = keys_[i + g * lanes + static_cast<std::size_t>(lane)];
            if (surface < 0)
                key = miss_key();
            else if (found.leaf[lane] < 0)
                key = tables_.entry_keys[surface];
            else
                key = key_of(surface, found.leaf[lane], false, false);
        }
    }
    if (!spheres_in_view_)
        return;
    spheres_.find_nearest(packet, packet_mask(rays.size() - i));
    meet_spheres(i, packet);
}

/// Writes down which rays of a packet met a sphere that stands apart.
template <Features has>
inline void BlockTracer<has>::meet_spheres(std::size_t i, const Packet& packet) {
    for (std::size_t ray = 0; ray < packet_rays; ++ray) {
        const std::int64_t surface = packet.surface[ray / lanes][ray % lanes];
        if (surface < 0 || surface == leaf_instead)
            continue;
        const auto sphere = static_cast<std::uint32_t>(surface) - tables_.surface_count;
        spheres_met_[i + ray] = sphere;
        keys_[i + ray] = patch_keys() + tables_.bvh_materials[sphere];
        sides_[i + ray] = {none, none};
    }
}

/// The key of a hit: which patch, from which side. A leaf can have a surface twice, inside and
/// outside of it.
template <Features has>
inline std::uint32_t BlockTracer<has>::key_of(std::int64_t surface, std::int64_t leaf, bool leaving,
                                              bool outwards) const {
    const std::uint32_t* user = tables_.users + tables_.user_begin[surface];
    const std::uint32_t* const end = tables_.users + tables_.user_begin[surface + 1];
    std::uint32_t found = *user;
    if (end - user > 1)
        for (; user != end; ++user) {
            const Patch& patch = tables_.patches[*user];
            if (patch.leaf != static_cast<std::uint32_t>(leaf))
                continue;
            found = *user;
            if (patch.flipped == (leaving != outwards))
                break;
        }
    return 2 * found + leaving;
}

template <Features has>
inline void BlockTracer<has>::trace_stateful(std::size_t i, Packet& packet) {
    RayQueue& rays = wave_.rays;
    const std::size_t used = std::min<std::size_t>(packet_rays, rays.size() - i);
    unsigned outside = 0; // of everything: only those see the spheres that stand apart
    for (std::size_t g = 0; g < packet_groups; ++g) {
        packet.rays[g] = rays.rays_at(i + g * lanes);
        packet.t[g] = never();
        packet.surface[g] = all_lanes(std::int64_t{none});
        outside |= bits_of(load(rays.fillers() + i + g * lanes) == all_lanes(std::int64_t{none}))
                   << (g * lanes);
    }
    if (spheres_in_view_ && (outside & packet_mask(used)) != 0)
        spheres_.find_nearest(packet, outside & packet_mask(used));
    for (std::size_t g = 0; g * lanes < used; ++g) {
        const std::size_t at = i + g * lanes;
        WideInt* const bits = walker_.bits();
        for (std::uint32_t w = 0; w < rays.words(); ++w)
            bits[w] = load(rays.inside(w) + at);
        const WideInt filler = load(rays.fillers() + at);
        if (!composites() && !any(filler != all_lanes(std::int64_t{none}))) {
            enter_from_outside(at, std::min<std::size_t>(lanes, used - g * lanes), packet.rays[g],
                               packet.t[g], packet.surface[g]);
            continue;
        }
        const Walker::Found found =
            walker_.first_change<has.composites>(packet.rays[g], filler, packet.t[g]);
        if (const Mask lost = (filler == all_lanes(std::int64_t{unresolved})) & (found.leaf >= 0);
            any(lost))
            return fail_overlap(
                LaneSet(walker_.find_leaves<has.composites>(), __builtin_ctz(bits_of(lost))));
        walker_.settle<has.composites>(found, (found.leaf >= 0) | (packet.surface[g] >= 0));
        for (std::uint32_t w = 0; w < rays.words(); ++w)
            store(rays.inside(w) + at, bits[w]);
        const WideInt* leaves = nullptr; // just before the hits, once they are asked for
        for (std::size_t lane = 0; lane < std::min<std::size_t>(lanes, used - g * lanes); ++lane) {
            const auto l = static_cast<int>(lane);
            keys_[at + lane] = miss_key();
            if (found.leaf[l] < 0)
                continue;
            packet.surface[g][l] = none; // the sphere is behind it
            const std::int64_t surface = found.surface[l];
            const bool leaving = found.leaf[l] == filler[l];
            const bool outwards = (bits[surface >> 6][l] >> (surface & 63) & 1) != 0;
            keys_[at + lane] = key_of(surface, found.leaf[l], leaving, outwards);
            // From outside into one leaf, nothing else matters.
            if (!leaving && filler[l] == none &&
                (tables_.all_relations || !tables_.shared_surfaces)) {
                sides_[at + lane] = {none, static_cast<std::int32_t>(found.leaf[l])};
                continue;
            }
            if (!leaves)
                leaves = walker_.find_leaves<has.composites>();
            fill(at + lane, LaneSet(leaves, l), found.leaf[l], surface);
        }
    }
    meet_spheres(i, packet);
}

/// Of rays outside of everything, which is outside of every surface: no bits change.
template <Features has>
inline void BlockTracer<has>::enter_from_outside(std::size_t at, std::size_t used,
                                                 const WideRays& rays, Wide limit,
                                                 WideInt& sphere) {
    const Walker::Found found = walker_.first_entry<has.composites>(rays, limit);
    for (std::size_t lane = 0; lane < used; ++lane) {
        const std::int64_t surface = found.surface[lane];
        keys_[at + lane] = surface < 0 ? miss_key() : tables_.entry_keys[surface];
        if (surface < 0)
            continue;
        sphere[lane] = none; // it is behind the surface
        sides_[at + lane] = {none, tables_.leaf_of_surface[surface]};
    }
}

/// What fills the space on both sides of a hit. `before`: the leaves just before it.
template <Features has>
inline void BlockTracer<has>::fill(std::size_t ray, LaneSet before, std::int64_t leaf,
                                   std::int64_t surface) {
    std::int64_t& filler = wave_.rays.fillers()[ray];
    const bool leaving = leaf == filler;
    Sides& sides = sides_[ray];
    const auto leaf_word = static_cast<std::uint32_t>(leaf >> 6);
    const std::uint64_t leaf_bit = std::uint64_t{1} << (leaf & 63);
    const auto after = [&](std::uint32_t w) {
        return tables_.shared_surfaces ? crossed(ray, surface, w)
                                       : before(w) ^ (w == leaf_word ? leaf_bit : 0);
    };
    sides.after = filler_of(tables_, after);
    sides.beyond = static_cast<std::int32_t>(filler);
    if (leaving) { // what it displaced comes to light, or what begins where it ends
        const std::uint64_t* displaced =
            tables_.displaced_by + static_cast<std::size_t>(leaf) * tables_.leaf_words;
        const auto beyond = [&](std::uint32_t w) { return after(w) & (displaced[w] | ~before(w)); };
        sides.beyond = filler_of(tables_, beyond);
        if (sides.beyond == unresolved)
            return fail_overlap(beyond);
    }
    if (!tables_.all_relations && filler != none)
        filler = filler_of(tables_, before);
}

/// The leaves on the other side of a surface that several share.
template <Features has>
inline std::uint64_t BlockTracer<has>::crossed(std::size_t ray, std::int64_t surface,
                                               std::uint32_t w) {
    const auto inside = [&](std::uint32_t s) {
        const bool is_inside = (wave_.rays.inside(s >> 6)[ray] >> (s & 63) & 1) != 0;
        return is_inside != (s == static_cast<std::uint32_t>(surface));
    };
    std::uint64_t word = 0;
    for (std::uint32_t leaf = 64 * w; leaf < std::min(tables_.leaf_count, 64 * w + 64); ++leaf)
        if (holds(tables_, tables_.leaves[leaf].root, inside))
            word |= std::uint64_t{1} << (leaf & 63);
    return word;
}

/// By key; of one key, hits on spheres that stand apart by where in the hierarchy these are, so
/// that neighbours lie together and their shadow and mirror rays meet the same boxes; else by ray.
template <Features has>
inline void BlockTracer<has>::sort_hits() {
    const std::size_t n = wave_.rays.size();
    order_.resize(n);
    std::iota(order_.begin(), order_.end(), 0u);
    if (apart())
        sort_stably(sphere_places, [&](std::uint32_t ray) {
            if (keys_[ray] < patch_keys() || keys_[ray] == miss_key())
                return 0u;
            return static_cast<std::uint32_t>(std::uint64_t{spheres_met_[ray]} * sphere_places /
                                              tables_.bvh_sphere_count);
        });
    const std::size_t keys = std::size_t{miss_key()} + 1;
    if (keys <= 4 * n) {
        sort_stably(keys, [&](std::uint32_t ray) { return keys_[ray]; });
        return;
    }
    // Counting costs a step for each key there is, which may be many more than rays.
    std::stable_sort(order_.begin(), order_.end(),
                     [&](std::uint32_t a, std::uint32_t b) { return keys_[a] < keys_[b]; });
}

/// Sorts `order_` by number_of(ray), less than `numbers`.
template <Features has>
template <class F>
inline void BlockTracer<has>::sort_stably(std::size_t numbers, F&& number_of) {
    number_begin_.assign(numbers + 1, 0u);
    for (const std::uint32_t ray : order_)
        ++number_begin_[number_of(ray) + 1];
    for (std::size_t k = 1; k < number_begin_.size(); ++k)
        number_begin_[k] += number_begin_[k - 1];
    sorted_.resize(order_.size());
    for (const std::uint32_t ray : order_)
        sorted_[number_begin_[number_of(ray)]++] = ray;
    std::swap(order_, sorted_);
}

} // namespace
} // namespace fraja::kernel
