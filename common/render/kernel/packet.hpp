// Sixteen rays at once through the hierarchy of spheres.
//
// A node's eight boxes are first tested against an interval that holds all rays of the packet, then
// each that is left against the rays one by one, in single precision, conservatively: an origin is
// rounded both ways, and the far side is moved away by a few units in the last place. Spheres are
// tested in double precision. After E. Reinhard et al. and A. Reshetov et al., "Multi-Level Ray
// Tracing Algorithm" (2005).
#pragma once

#include "common/render/kernel/beam.hpp"
#include "common/render/kernel/roots.hpp"
#include "common/render/kernel/tables.hpp"
#include "common/render/kernel/wide.hpp"

#include <cstdint>
#include <utility>

namespace fraja::kernel {
namespace {

constexpr int packet_rays = 16;
constexpr int packet_groups = packet_rays / lanes;

// Single precision: twice the lanes.
constexpr int float_lanes = 2 * lanes;
using Float = float __attribute__((vector_size(4 * float_lanes)));
using FloatMask = std::int32_t __attribute__((vector_size(4 * float_lanes)));
constexpr int float_groups = packet_rays / float_lanes;

FRAJA_WIDE Float all_floats(float x) {
    return x - Float{};
}
FRAJA_WIDE Float load_floats(const float* from) {
    Float f;
    std::memcpy(&f, from, sizeof f);
    return f;
}
FRAJA_WIDE void store_floats(float* to, Float f) {
    std::memcpy(to, &f, sizeof f);
}
FRAJA_WIDE Float lesser(Float a, Float b) {
    return a < b ? a : b;
}
FRAJA_WIDE Float greater(Float a, Float b) {
    return a > b ? a : b;
}
FRAJA_WIDE unsigned bits_of_floats(FloatMask m) {
#if defined(FRAJA_AVX512)
    return _mm512_movepi32_mask(reinterpret_cast<__m512i>(m));
#elif defined(__AVX2__)
    return static_cast<unsigned>(_mm256_movemask_ps(reinterpret_cast<__m256>(m)));
#elif defined(__SSE2__)
    return static_cast<unsigned>(_mm_movemask_ps(reinterpret_cast<__m128>(m)));
#else
    unsigned bits = 0;
    for (int i = 0; i < float_lanes; ++i)
        bits |= m[i] ? 1u << i : 0u;
    return bits;
#endif
}

/// The boxes of a node.
using Eight = float __attribute__((vector_size(4 * bvh_width)));
using EightMask = std::int32_t __attribute__((vector_size(4 * bvh_width)));

FRAJA_WIDE unsigned bits_of_eight(EightMask m) {
#if defined(__AVX2__)
    return static_cast<unsigned>(_mm256_movemask_ps(reinterpret_cast<__m256>(m)));
#else
    unsigned bits = 0;
    for (std::size_t i = 0; i < bvh_width; ++i)
        bits |= m[i] ? 1u << i : 0u;
    return bits;
#endif
}

/// Rays of which each finds its nearest sphere; they start outside of all.
struct Packet {
    WideRays rays[packet_groups];
    Wide t[packet_groups];          ///< the limit, then the hit
    WideInt surface[packet_groups]; ///< of the hit; untouched without one
};

/// In the place of a sphere's surface: the limit is where a leaf is hit, and a sphere at the same
/// distance is taken instead.
constexpr std::int64_t leaf_instead = INT64_MAX;

class PacketTracer {
public:
    explicit PacketTracer(const Tables& tables) : tables_(tables) {}

    /// Of the rays in `active`, a bit for each.
    void find_nearest(Packet& packet, unsigned active) {
        for_each_octant(packet, active, [&](unsigned rays) { traverse<false>(packet, rays); });
    }
    /// Which of the active rays meet a sphere nearer than their limit.
    unsigned find_blocked(Packet& packet, unsigned active) {
        unsigned blocked = 0;
        for_each_octant(packet, active,
                        [&](unsigned rays) { blocked |= traverse<true>(packet, rays); });
        return blocked;
    }

    /// Whether a ray of the beam might meet a sphere; true where that takes too long to tell.
    [[nodiscard]] bool may_meet(const Beam& beam);

    void count_from_zero() { box_tests_ = form_tests_ = 0; }
    [[nodiscard]] std::uint64_t box_tests() const { return box_tests_; }
    [[nodiscard]] std::uint64_t form_tests() const { return form_tests_; }

private:
    /// What the boxes are tested with, by axis. Near and far are the sides that rays of the octant
    /// enter and leave a box by.
    struct Slabs {
        float near_origin[3][packet_rays], far_origin[3][packet_rays]; ///< rounded towards, away
        float inverse[3][packet_rays];                                 ///< of the direction
        float limit[packet_rays];
        // The interval of all active rays.
        float near_most[3], far_least[3], inverse_least[3], inverse_most[3];
        bool negative[3];
    };

    template <class F>
    static void for_each_octant(const Packet& packet, unsigned active, F&& f) {
        unsigned negative[3] = {};
        for (int g = 0; g < packet_groups; ++g) {
            const Wide3& d = packet.rays[g].dir;
            negative[0] |= bits_of(d.x < 0) << (g * lanes);
            negative[1] |= bits_of(d.y < 0) << (g * lanes);
            negative[2] |= bits_of(d.z < 0) << (g * lanes);
        }
        while (active != 0) {
            unsigned same = active;
            const unsigned first = static_cast<unsigned>(__builtin_ctz(active));
            for (const unsigned n : negative)
                same &= n >> first & 1 ? n : ~n;
            f(same);
            active &= ~same;
        }
    }

    void prepare(const Packet& packet, unsigned active);
    struct Boxes {
        unsigned which; ///< a bit each
        Eight near;
    };
    [[nodiscard]] Boxes boxes_met(const BvhNode& node, unsigned ray) const;
    [[nodiscard]] Boxes boxes_met(const BvhNode& node, float limit) const;
    void rays_meeting(const BvhNode& node, unsigned rays, unsigned candidates,
                      unsigned (&met)[bvh_width]);
    [[nodiscard]] Boxes boxes_met_by(const BvhNode& node, unsigned rays,
                                     unsigned (&met)[bvh_width]);
    [[nodiscard]] float farthest_limit() const;
    template <bool any_hit>
    bool traverse_alone(Packet& packet, unsigned ray, std::int32_t child);
    void load_sides(const BvhNode& node, int axis, Eight& low, Eight& high) const;
    [[nodiscard]] unsigned meeting_box(const BvhNode& node, std::size_t child,
                                       unsigned active) const;
    template <bool any_hit>
    unsigned test_spheres(Packet& packet, unsigned active, std::int32_t leaf);
    template <bool any_hit>
    unsigned traverse(Packet& packet, unsigned active);

    const Tables& tables_;
    Slabs slabs_;
    std::uint64_t box_tests_ = 0, form_tests_ = 0;
};

/// The least of all lanes, in each.
template <int step = float_lanes / 2>
FRAJA_WIDE Float least(Float f) {
    if constexpr (step == 0) {
        return f;
    } else {
        const Float turned = [&]<int... I>(std::integer_sequence<int, I...>) {
            return __builtin_shufflevector(f, f, ((I + step) % float_lanes)...);
        }
        (std::make_integer_sequence<int, float_lanes>{});
        return least<step / 2>(lesser(f, turned));
    }
}

/// Sixteen doubles as floats, each rounded to the nearest.
FRAJA_WIDE void store_rounded(float* to, const Wide (&from)[packet_groups]) {
    for (int g = 0; g < packet_groups; ++g) {
        using Half = float __attribute__((vector_size(4 * lanes)));
        const Half half = __builtin_convertvector(from[g], Half);
        std::memcpy(to + g * lanes, &half, sizeof half);
    }
}

/// More than half a unit in the last place of any float of that magnitude.
FRAJA_WIDE Float rounding_of(Float f) {
    const Float magnitude = f < 0 ? -f : f;
    return magnitude * 1.2e-7f + 1e-37f;
}

FRAJA_WIDE void PacketTracer::prepare(const Packet& packet, unsigned active) {
    Slabs& s = slabs_;
    const unsigned first = static_cast<unsigned>(__builtin_ctz(active));
    FloatMask used[float_groups];
    for (int g = 0; g < float_groups; ++g) {
        FloatMask lane_bit{};
        for (int lane = 0; lane < float_lanes; ++lane)
            lane_bit[lane] = 1 << lane;
        used[g] = (static_cast<int>(active >> (g * float_lanes)) & lane_bit) != 0;
    }
    store_rounded(s.limit, packet.t);
    for (int g = 0; g < float_groups; ++g) {
        const Float limit = load_floats(s.limit + g * float_lanes);
        store_floats(s.limit + g * float_lanes, limit + rounding_of(limit));
    }
    for (int axis = 0; axis < 3; ++axis) {
        const auto of = [&](const Wide3& v) { return axis == 0 ? v.x : axis == 1 ? v.y : v.z; };
        s.negative[axis] = of(packet.rays[first / lanes].dir)[first % lanes] < 0;
        // Mirrored, so that all rays of an octant go towards +.
        const double sign = s.negative[axis] ? -1 : 1;
        Wide origin[packet_groups], dir[packet_groups];
        for (int g = 0; g < packet_groups; ++g) {
            origin[g] = sign * of(packet.rays[g].origin);
            dir[g] = greater(sign * of(packet.rays[g].dir), all_lanes(1e-30));
        }
        store_rounded(s.near_origin[axis], origin);
        store_rounded(s.inverse[axis], dir);
        Float most_near = all_floats(__builtin_inff()), least_far = most_near;
        Float least_inverse = most_near, most_inverse = most_near; // the most: negated
        for (int g = 0; g < float_groups; ++g) {
            const Float o = load_floats(s.near_origin[axis] + g * float_lanes);
            const Float slack = rounding_of(o);
            const Float near = o + slack, far = o - slack;
            const Float inverse = 1.0f / load_floats(s.inverse[axis] + g * float_lanes);
            store_floats(s.near_origin[axis] + g * float_lanes, near);
            store_floats(s.far_origin[axis] + g * float_lanes, far);
            store_floats(s.inverse[axis] + g * float_lanes, inverse);
            const Float none_of = all_floats(__builtin_inff());
            most_near = lesser(most_near, used[g] ? -near : none_of);
            least_far = lesser(least_far, used[g] ? far : none_of);
            least_inverse = lesser(least_inverse, used[g] ? inverse : none_of);
            most_inverse = lesser(most_inverse, used[g] ? -inverse : none_of);
        }
        s.near_most[axis] = -least(most_near)[0];
        s.far_least[axis] = least(least_far)[0];
        s.inverse_least[axis] = least(least_inverse)[0];
        s.inverse_most[axis] = -least(most_inverse)[0];
    }
}

/// Eight roundings, each of half a unit, lie between the quotients compared and the true ones.
constexpr float far_slack = 1 + 10 * 5.9604645e-8f;

inline unsigned PacketTracer::meeting_box(const BvhNode& node, std::size_t child,
                                          unsigned active) const {
    const Slabs& s = slabs_;
    unsigned met = 0;
    for (int g = 0; g < float_groups; ++g) {
        Float near{}, far = load_floats(s.limit + g * float_lanes);
        for (int axis = 0; axis < 3; ++axis) {
            const float low = s.negative[axis] ? -node.high[axis][child] : node.low[axis][child];
            const float high = s.negative[axis] ? -node.low[axis][child] : node.high[axis][child];
            const Float inverse = load_floats(s.inverse[axis] + g * float_lanes);
            near =
                greater((low - load_floats(s.near_origin[axis] + g * float_lanes)) * inverse, near);
            far = lesser((high - load_floats(s.far_origin[axis] + g * float_lanes)) * inverse, far);
        }
        met |= bits_of_floats(near <= far * far_slack) << (g * float_lanes);
    }
    return met & active;
}

/// The children whose boxes one ray meets.
FRAJA_WIDE PacketTracer::Boxes PacketTracer::boxes_met(const BvhNode& node, unsigned ray) const {
    const Slabs& s = slabs_;
    Eight near{}, far = s.limit[ray] - Eight{};
    for (int axis = 0; axis < 3; ++axis) {
        Eight low, high;
        load_sides(node, axis, low, high);
        const float inverse = s.inverse[axis][ray];
        const Eight enter = (low - s.near_origin[axis][ray]) * inverse;
        const Eight leave = (high - s.far_origin[axis][ray]) * inverse;
        near = enter > near ? enter : near;
        far = leave < far ? leave : far;
    }
    return {bits_of_eight(near <= far * far_slack), near};
}

/// The sides that rays of the octant enter and leave a node's boxes by, mirrored as the rays are.
FRAJA_WIDE void PacketTracer::load_sides(const BvhNode& node, int axis, Eight& low,
                                         Eight& high) const {
    const bool negative = slabs_.negative[axis];
    std::memcpy(&low, negative ? node.high[axis] : node.low[axis], sizeof low);
    std::memcpy(&high, negative ? node.low[axis] : node.high[axis], sizeof high);
    if (negative)
        low = -low, high = -high;
}

template <bool any_hit>
FRAJA_WIDE unsigned PacketTracer::test_spheres(Packet& packet, unsigned active, std::int32_t leaf) {
    const auto begin = static_cast<std::uint32_t>(~leaf) >> 3;
    const std::uint32_t count = (static_cast<std::uint32_t>(~leaf) & 7) + 1;
    form_tests_ += count * static_cast<unsigned>(__builtin_popcount(active));
    unsigned hits = 0;
    [[maybe_unused]] Mask is_active[packet_groups];
    if constexpr (!any_hit)
        for (int g = 0; g < packet_groups; ++g)
            is_active[g] = mask_of(active >> (g * lanes) & every_lane);
    for (std::uint32_t i = begin; i < begin + count; ++i) {
        const SphereSurface& sphere = tables_.bvh_spheres[i];
        const std::int64_t index = std::int64_t{tables_.surface_count} + i;
        for (int g = 0; g < packet_groups; ++g) {
            if (!(active >> (g * lanes) & every_lane))
                continue;
            const Wide entry = entry_of(sphere, index, packet.rays[g]);
            Mask nearer = entry < packet.t[g];
            if constexpr (!any_hit) // of two at one distance the first, whenever it is tested
                nearer =
                    (nearer | ((entry == packet.t[g]) & (all_lanes(index) < packet.surface[g]))) &
                    is_active[g];
            const unsigned bits = bits_of(nearer) << (g * lanes) & active;
            if (bits == 0)
                continue;
            hits |= bits;
            if constexpr (!any_hit) {
                packet.t[g] = select(nearer, entry, packet.t[g]);
                packet.surface[g] = select(nearer, all_lanes(index), packet.surface[g]);
            }
        }
    }
    if constexpr (!any_hit)
        for (unsigned left = hits; left != 0; left &= left - 1) {
            const auto ray = static_cast<unsigned>(__builtin_ctz(left));
            const auto limit = static_cast<float>(packet.t[ray / lanes][ray % lanes]);
            slabs_.limit[ray] = limit + (limit * 1.2e-7f + 1e-37f);
        }
    return hits;
}

/// Boxes (or leaves) that wait while a nearer one is looked into.
class BoxStack {
public:
    struct Entry {
        std::int32_t child;
        unsigned rays;
        float near;
    };
    [[nodiscard]] bool empty() const { return top_ == 0; }
    [[nodiscard]] int size() const { return top_; }
    Entry pop() { return entries_[--top_]; }
    /// If `ordered`, among those from `bottom` on the nearest is last.
    template <bool ordered>
    void push(const Entry& entry, int bottom) {
        int place = top_++;
        for (; ordered && place > bottom && entries_[place - 1].near < entry.near; --place)
            entries_[place] = entries_[place - 1];
        entries_[place] = entry;
    }

private:
    Entry entries_[bvh_stack_max];
    int top_ = 0;
};

/// Of one ray, the rest of its way through a part of the hierarchy; whether it hit.
template <bool any_hit>
bool PacketTracer::traverse_alone(Packet& packet, unsigned ray, std::int32_t child) {
    const unsigned rays = 1u << ray;
    BoxStack stack;
    stack.push<false>({child, rays, 0}, 0);
    bool hit = false;
    while (!stack.empty()) {
        const BoxStack::Entry at = stack.pop();
        if (at.near > slabs_.limit[ray] * far_slack)
            continue;
        if (at.child < 0) {
            hit |= test_spheres<any_hit>(packet, rays, at.child) != 0;
            if (any_hit && hit)
                return true;
            continue;
        }
        const BvhNode& node = tables_.bvh[at.child];
        box_tests_ += bvh_width;
        const Boxes met = boxes_met(node, ray);
        float near[bvh_width];
        std::memcpy(near, &met.near, sizeof near);
        const int bottom = stack.size();
        for (unsigned boxes = met.which; boxes != 0; boxes &= boxes - 1) {
            const auto i = static_cast<std::size_t>(__builtin_ctz(boxes));
            // Any hit will do: whichever comes first.
            stack.push<!any_hit>({node.child[i], rays, near[i]}, bottom);
        }
    }
    return hit;
}

/// The boxes that the interval of all rays meets.
FRAJA_WIDE PacketTracer::Boxes PacketTracer::boxes_met(const BvhNode& node, float limit) const {
    const Slabs& s = slabs_;
    Eight enter{}, leave = limit - Eight{};
    for (int axis = 0; axis < 3; ++axis) {
        Eight low, high;
        load_sides(node, axis, low, high);
        const Eight to_low = low - s.near_most[axis];
        const Eight to_high = high - s.far_least[axis];
        const Eight a = to_low * s.inverse_least[axis], b = to_low * s.inverse_most[axis];
        const Eight c = to_high * s.inverse_least[axis], d = to_high * s.inverse_most[axis];
        const Eight first = a < b ? a : b, last = c > d ? c : d;
        enter = first > enter ? first : enter;
        leave = last < leave ? last : leave;
    }
    return {bits_of_eight(enter <= leave * far_slack), enter};
}

/// So few are tested one by one at once.
constexpr int few_rays = 4;

/// The boxes that any of some rays meet, and which of them.
FRAJA_WIDE PacketTracer::Boxes PacketTracer::boxes_met_by(const BvhNode& node, unsigned rays,
                                                          unsigned (&met)[bvh_width]) {
    Boxes all{0, __builtin_inff() - Eight{}};
    for (; rays != 0; rays &= rays - 1) {
        const auto ray = static_cast<unsigned>(__builtin_ctz(rays));
        const Boxes its = boxes_met(node, ray);
        all.which |= its.which;
        all.near = its.near < all.near ? its.near : all.near;
        for (unsigned boxes = its.which; boxes != 0; boxes &= boxes - 1)
            met[__builtin_ctz(boxes)] |= 1u << ray;
        box_tests_ += bvh_width;
    }
    return all;
}

/// Of some rays of a node those that meet each of its boxes, as far as these are candidates.
inline void PacketTracer::rays_meeting(const BvhNode& node, unsigned rays, unsigned candidates,
                                       unsigned (&met)[bvh_width]) {
    const int ray_count = __builtin_popcount(rays), box_count = __builtin_popcount(candidates);
    box_tests_ += static_cast<unsigned>(ray_count * box_count);
    // Few rays are tested against all boxes at once, many against one box after the other.
    if (ray_count >= float_groups * box_count) {
        for (; candidates != 0; candidates &= candidates - 1) {
            const auto box = static_cast<std::size_t>(__builtin_ctz(candidates));
            met[box] = meeting_box(node, box, rays);
        }
        return;
    }
    for (; rays != 0; rays &= rays - 1) {
        const auto ray = static_cast<unsigned>(__builtin_ctz(rays));
        for (unsigned boxes = boxes_met(node, ray).which & candidates; boxes != 0;
             boxes &= boxes - 1)
            met[__builtin_ctz(boxes)] |= 1u << ray;
    }
}

inline bool PacketTracer::may_meet(const Beam& beam) {
    constexpr int nodes_max = 64;
    std::int32_t waiting[nodes_max * bvh_width] = {0};
    int count = 1;
    for (int visited = 0; count > 0; ++visited) {
        if (visited == nodes_max)
            return true;
        const BvhNode& node = tables_.bvh[waiting[--count]];
        box_tests_ += bvh_width;
        for (std::size_t i = 0; i < bvh_width; ++i) {
            double center[3], radius_squared = 0;
            for (int axis = 0; axis < 3; ++axis) {
                const double low = node.low[axis][i], high = node.high[axis][i];
                center[axis] = 0.5 * (low + high);
                radius_squared += 0.25 * (high - low) * (high - low);
            }
            if (!(node.low[0][i] <= node.high[0][i])) // no child
                continue;
            if (beam.misses(center, __builtin_sqrt(radius_squared)))
                continue;
            if (node.child[i] < 0)
                return true;
            waiting[count++] = node.child[i];
        }
    }
    return false;
}

template <bool any_hit>
unsigned PacketTracer::traverse(Packet& packet, unsigned active) {
    prepare(packet, active);
    unsigned blocked = 0;
    float farthest = farthest_limit();
    // What rays hit: they are done, or look no farther.
    const auto take = [&](unsigned hits) {
        if constexpr (any_hit) {
            blocked |= hits;
            active &= ~hits;
        } else if (hits != 0) {
            farthest = farthest_limit();
        }
    };
    BoxStack stack;
    stack.push<false>({0, active, 0}, 0);
    while (!stack.empty() && active != 0) {
        const BoxStack::Entry at = stack.pop();
        const unsigned rays = at.rays & active;
        if (rays == 0 || at.near > farthest * far_slack)
            continue;
        if (at.child < 0) {
            take(test_spheres<any_hit>(packet, rays, at.child));
            continue;
        }
        if ((rays & (rays - 1)) == 0) {
            const auto ray = static_cast<unsigned>(__builtin_ctz(rays));
            take(traverse_alone<any_hit>(packet, ray, at.child) ? rays : 0);
            continue;
        }
        const BvhNode& node = tables_.bvh[at.child];
        box_tests_ += bvh_width;
        unsigned met[bvh_width] = {};
        Boxes candidates;
        if (__builtin_popcount(rays) <= few_rays) {
            candidates = boxes_met_by(node, rays, met);
        } else {
            candidates = boxes_met(node, farthest);
            rays_meeting(node, rays, candidates.which, met);
        }
        float near[bvh_width];
        std::memcpy(near, &candidates.near, sizeof near);
        const int bottom = stack.size();
        for (unsigned boxes = candidates.which; boxes != 0; boxes &= boxes - 1) {
            const auto i = static_cast<std::size_t>(__builtin_ctz(boxes));
            if (met[i] != 0)
                stack.push<!any_hit>({node.child[i], met[i], near[i]}, bottom);
        }
    }
    return blocked;
}

/// Of rays that are not active as well, which does no harm.
FRAJA_WIDE float PacketTracer::farthest_limit() const {
    Float most = -load_floats(slabs_.limit);
    for (int g = 1; g < float_groups; ++g)
        most = lesser(most, -load_floats(slabs_.limit + g * float_lanes));
    return -least(most)[0];
}

} // namespace
} // namespace fraja::kernel
