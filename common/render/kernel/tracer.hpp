// Draws a block of samples: wave after wave of rays, those of one depth at a time.
//
// A block of samples starts as a wave of camera rays (samples.hpp). A wave is traced in packets
// (hits.hpp), its hits are sorted by material, so that a group has one, and shading makes the next
// wave (light.hpp).
//
// The bits of a sample depend on nothing but the sample: the sort is stable and its keys are the
// ray's own, so the rays of a sample meet in the same order whatever else is in the wave.
#pragma once

#include "common/render/kernel/packet.hpp"
#include "common/render/kernel/queue.hpp"
#include "common/render/kernel/refine.hpp"
#include "common/render/kernel/shade.hpp"
#include "common/render/kernel/tables.hpp"
#include "common/render/kernel/walk.hpp"

#include <utility>
#include <vector>

namespace fraja::kernel {
namespace {

/// A wave of more rays is split: by samples, or the rays of one sample that has as many.
constexpr std::size_t wave_rays_max = 32768;
/// Hits that are shaded together: of one material, they look for what is in the light's way once.
constexpr std::size_t batch_rays = 128;
/// Parts of the hierarchy by which hits are sorted.
constexpr std::size_t sphere_places = 1024;
/// Rays between two questions whether to go on.
constexpr std::size_t rays_per_report = 1024;

template <class Vector, class Number, std::size_t... I>
FRAJA_WIDE Vector gather(const Number* column, const std::uint32_t* index,
                         std::index_sequence<I...>) {
    return Vector{column[index[I]]...};
}
FRAJA_WIDE Wide gather(const double* column, const std::uint32_t* index) {
    return gather<Wide>(column, index, std::make_index_sequence<lanes>{});
}
FRAJA_WIDE WideInt gather(const std::int64_t* column, const std::uint32_t* index) {
    return gather<WideInt>(column, index, std::make_index_sequence<lanes>{});
}

struct Wave {
    RayQueue rays;
    std::uint32_t depth = 0; ///< surfaces they may still meet, at least 1
};

/// Wide hits with one material.
struct Group {
    const Patch* patch; ///< null: on spheres that stand apart
    const Material* material;
    bool leaving;
    const std::uint32_t* index; ///< of the rays; the last one stands for unused lanes
    Mask active;
};

/// Wide rays at a surface.
struct Incidence {
    Group group;
    WideInt owner; ///< the surface
    Wide3 dir;
    WideHit hit;      ///< its normal points out of the leaf
    Wide cosine;      ///< of normal and ray
    Wide3 mirror_dir; ///< not normalised
    Wide3 coefficient;
    Wide3 kd; ///< once it is needed
    bool textured;
    Wide3 light;  ///< local, so far
    WideInt path; ///< which lights do light it, if asked for
};

/// What a block's camera rays may meet.
enum class View : std::uint8_t { everything, some, one_plane, nothing };

template <Features has>
class BlockTracer {
public:
    explicit BlockTracer(const Tables& tables);

    /// Its tables may be gone.
    [[nodiscard]] std::uint64_t scene() const { return scene_; }
    BlockResult draw(const SampleJob& job, const Block& block, const DrawControl& control);
    BlockResult find_first_hits(const FirstHits& block, const DrawControl& control);

private:
    // first_hits.hpp
    void note_first_hits(std::size_t groups);

    // samples.hpp
    void begin(const SampleJob& job, const Block& block, const DrawControl& control);
    BlockResult end();
    void draw_samples();
    void show_background();
    /// A camera outside of every leaf is outside of every surface where these are the same.
    [[nodiscard]] bool starts_are_outside() const {
        return tables_.camera_is_outside && !composites();
    }
    [[nodiscard]] bool stateful() const { return has.state && tables_.stateful; }
    [[nodiscard]] bool composites() const { return has.composites && !tables_.leaf_is_surface; }
    [[nodiscard]] bool apart() const { return has.apart && tables_.bvh != nullptr; }
    void start_wave();
    void camera_rays(const Wide x, const Wide y, std::size_t at);
    void follow_waves();
    void follow_wave();
    void sort_by_direction();
    void split_wave();

    // view.hpp
    [[nodiscard]] View look_through();
    void meet_plane(std::int32_t plane);

    // hits.hpp
    void trace();
    void trace_packet(std::size_t i, Packet& packet);
    void trace_stateful(std::size_t i, Packet& packet);
    void trace_stateless(std::size_t i, Packet& packet);
    void enter_from_outside(std::size_t at, std::size_t used, const WideRays& rays, Wide limit,
                            WideInt& sphere);
    void meet_spheres(std::size_t i, const Packet& packet);
    [[nodiscard]] std::uint32_t key_of(std::int64_t surface, std::int64_t leaf, bool leaving,
                                       bool outwards) const;
    void fill(std::size_t ray, LaneSet before, std::int64_t leaf, std::int64_t surface);
    [[nodiscard]] std::uint64_t crossed(std::size_t ray, std::int64_t surface, std::uint32_t w);
    void sort_hits();
    template <class F>
    void sort_stably(std::size_t numbers, F&& number_of);

    // light.hpp
    /// Which hits a number stands for, and the order in which they are shaded: those on patches (by
    /// patch and side), on spheres that stand apart (by material), and misses.
    [[nodiscard]] std::uint32_t patch_keys() const {
        return 2 * tables_.user_begin[tables_.surface_count];
    }
    [[nodiscard]] std::uint32_t miss_key() const { return patch_keys() + tables_.material_count; }
    void shade();
    void add_background(const std::uint32_t* index, std::size_t count);
    void shade_batch(std::uint32_t key, const std::uint32_t* index, std::size_t count);
    Incidence meet(const Group& group);
    const Wide3& diffuse(Incidence& at);
    void add_light(std::size_t groups);
    bool look_towards(const Light& light, std::size_t groups);
    void add_light_of(const Light& light, std::size_t first, std::size_t groups,
                      bool may_be_shadowed);
    void cast_shadows(const Incidence* at, std::size_t groups, Packet& shadows, Mask* lit);
    void cast_within(const Incidence& at, const WideRays& rays, Wide limit, WideInt filler,
                     Mask& lit);
    Mask pass_through(const Incidence& at, Wide3& mirrored, Wide3& dir, Wide3& coefficient);
    void send_on(const Incidence& at);
    void send(const Incidence& at, int lane, const Wide3& dir, const Wide3& coefficient,
              bool crosses);
    void note_paths(const Incidence& at);
    void note_path(std::uint32_t sample, std::uint64_t what);
    void lose(const Incidence& at, Mask rays, const Wide3& coefficient);
    static void add_weight(double* to, std::uint32_t sample, const Wide3& coefficient, int lane) {
        if (to == nullptr)
            return;
        to += 3 * std::size_t{sample};
        to[0] += coefficient.x[lane], to[1] += coefficient.y[lane], to[2] += coefficient.z[lane];
    }

    [[nodiscard]] Mask below_cut(Wide3 c) const {
        return ~((c.x > job_.cut[0]) | (c.y > job_.cut[1]) | (c.z > job_.cut[2]));
    }
    [[nodiscard]] bool going_on() const { return result_.end == BlockEnd::drawn; }
    void report(std::uint64_t rays) {
        unreported_ += rays;
        if (unreported_ >= rays_per_report)
            report_now();
    }
    void report_now() {
        if (!control_.report(control_.owner, unreported_) && going_on())
            result_.end = BlockEnd::stopped;
        unreported_ = 0;
    }
    /// A ray needs a priority, among the leaves of a set, that the scene does not give.
    template <class WordOf>
    void fail_overlap(WordOf&& word_of) {
        if (!going_on())
            return;
        result_.end = BlockEnd::unresolved_overlap;
        for_each_bit(tables_.leaf_words, word_of, [&](std::int32_t leaf) {
            result_.overlapping[result_.overlapping_count++] = static_cast<std::uint32_t>(leaf);
            return result_.overlapping_count < overlapping_max;
        });
    }

    const Tables& tables_;
    std::uint64_t scene_;
    SampleJob job_{};
    Block block_{};
    DrawControl control_{};
    Walker walker_;
    PacketTracer spheres_;
    TableHit* first_hits_ = nullptr; ///< of each sample: nothing else is asked for
    View view_ = View::everything;
    Beam beam_{};                       ///< they are in it, but where they may meet everything
    std::int32_t plane_in_view_ = none; ///< where they all meet one
    bool spheres_in_view_ = false;      ///< of those apart; of the wave at work
    Wave wave_;
    RayQueue next_;
    std::vector<Wave> waiting_; ///< waves that were split off

    // Of each ray of the wave.
    std::vector<std::uint32_t> keys_;
    /// The leaves around a hit.
    struct Sides {
        std::int32_t beyond; ///< by whose index a ray is bent, with that of the leaf; none: ambient
        std::int32_t after;  ///< that fills the space on the other side
    };
    std::vector<Sides> sides_;               ///< none without state
    std::vector<std::uint32_t> spheres_met_; ///< that stand apart
    std::vector<std::uint32_t> order_;       ///< the rays, by key
    std::vector<std::uint32_t> sorted_, number_begin_;

    std::vector<Incidence> batch_;
    std::uint64_t unreported_ = 0;
    BlockResult result_;
};

} // namespace
} // namespace fraja::kernel
