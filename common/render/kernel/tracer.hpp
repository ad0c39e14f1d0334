// Draws a tile: wave after wave of rays, those of one depth at a time.
//
// A block of samples starts as a wave of camera rays. A wave is traced in groups of lanes, its hits
// are sorted by patch, so that a group has one material, and shading makes the next wave.
//
// The bits of a sample depend on nothing but the sample: the sort is stable and its keys are the
// ray's own, so the rays of a sample meet in the same order whatever else is in the wave.
#pragma once

#include "common/render/kernel/queue.hpp"
#include "common/render/kernel/refine.hpp"
#include "common/render/kernel/shade.hpp"
#include "common/render/kernel/tables.hpp"
#include "common/render/kernel/walk.hpp"

#include <limits>
#include <optional>

namespace fraja::kernel {
namespace {

/// Samples whose camera rays make a wave.
constexpr std::uint32_t block_samples = 512;
/// A wave of more rays is split: by samples, or the rays of one sample that has as many.
constexpr std::size_t wave_rays_max = 32768;
/// Rays between two questions whether to go on.
constexpr std::size_t rays_per_report = 1024;

FRAJA_WIDE Wide gather(const double* column, const std::uint32_t* index) {
    Wide w{};
    for (int i = 0; i < lanes; ++i)
        w[i] = column[index[i]];
    return w;
}
FRAJA_WIDE WideInt gather(const std::int64_t* column, const std::uint32_t* index) {
    WideInt w{};
    for (int i = 0; i < lanes; ++i)
        w[i] = column[index[i]];
    return w;
}

struct Wave {
    RayQueue rays;
    std::uint32_t depth = 0; ///< surfaces they may still meet, at least 1
};

class TileTracer {
public:
    TileTracer(const Tables& tables, const TileJob& job, const TileControl& control)
        : tables_(tables), job_(job), control_(control),
          walker_(tables), wave_{RayQueue(tables.surface_words)}, next_(tables.surface_words),
          key_begin_(2 * std::size_t{patch_count(tables)} + 2) {}

    TileResult draw();

private:
    static std::uint32_t patch_count(const Tables& t) { return t.user_begin[t.surface_count]; }
    [[nodiscard]] std::uint32_t miss_key() const { return 2 * patch_count(tables_); }
    [[nodiscard]] bool going_on() const { return result_.end == TileEnd::drawn; }

    void draw_block(std::uint64_t first_sample, std::uint32_t count);
    void start_wave(std::uint64_t first_sample, std::uint32_t count);
    void camera_rays(std::uint64_t first_sample, std::size_t at);
    void follow_wave();
    void split_wave();

    void trace();
    void trace_stateful(std::size_t i);
    void trace_stateless(std::size_t i);
    [[nodiscard]] std::uint32_t key_of(std::int64_t surface, std::int64_t leaf, bool leaving,
                                       bool outwards) const;
    void fill(std::size_t ray, LaneSet before, std::int64_t leaf, std::int64_t surface);
    [[nodiscard]] std::uint64_t crossed(std::size_t ray, std::int64_t surface, std::uint32_t w);
    void sort_hits();
    void shade();
    void add_background(const std::uint32_t* index, std::size_t count);

    /// Wide hits on one side of one patch.
    struct Group {
        const Patch& patch;
        bool leaving;
        const std::uint32_t* index; ///< of the rays; the last one stands for unused lanes
        Mask active;
    };
    struct Incidence;
    void shade_group(const Group& group);
    Wide3 light_on(const Incidence& at);
    Mask lit_by(const Light& light, const Incidence& at, Wide3 to_light, Wide distance,
                Mask candidates);
    void send_on(const Incidence& at);

    [[nodiscard]] Mask below_cut(Wide3 c) const {
        return ~((c.x > job_.cut[0]) | (c.y > job_.cut[1]) | (c.z > job_.cut[2]));
    }
    void report(std::uint64_t rays) {
        unreported_ += rays;
        if (unreported_ >= rays_per_report)
            report_now();
    }
    void report_now() {
        if (!control_.report(control_.owner, unreported_) && going_on())
            result_.end = TileEnd::stopped;
        unreported_ = 0;
    }
    /// A ray needs a priority, among the leaves of a set, that the scene does not give.
    template <class WordOf>
    void fail_overlap(WordOf&& word_of) {
        if (!going_on())
            return;
        result_.end = TileEnd::unresolved_overlap;
        overlapping_pair(tables_, word_of, result_.overlapping);
    }

    const Tables& tables_;
    const TileJob& job_;
    const TileControl& control_;
    Walker walker_;
    Wave wave_;
    RayQueue next_;
    std::vector<Wave> waiting_;       ///< waves that were split off
    std::vector<std::uint32_t> keys_; ///< of each ray's hit: patch and side, or a miss
    /// The leaves around a hit.
    struct Sides {
        std::int32_t beyond; ///< by whose index a ray is bent, with that of the leaf; none: ambient
        std::int32_t after;  ///< that fills the space on the other side
    };
    std::vector<Sides> sides_;         ///< of each ray's hit; none without state
    std::vector<std::uint32_t> order_; ///< the rays, by key
    std::vector<std::uint32_t> key_begin_;
    std::vector<double> radiance_;       ///< of each sample of the block: red, green, blue
    std::vector<std::uint32_t> rays_of_; ///< of each sample of the block
    std::uint64_t unreported_ = 0;
    TileResult result_;
};

// ------------------------------------------------------------------------------------ the samples

/// The last guard: absurd colours (1e300 times 1e300) must not put into a picture what is no
/// number.
inline float as_float(double radiance) {
    constexpr float most = std::numeric_limits<float>::max();
    if (!(radiance > 0))
        return 0;
    return radiance < static_cast<double>(most) ? static_cast<float>(radiance) : most;
}

TileResult TileTracer::draw() {
    const std::uint32_t n = job_.aa == 0 ? 1 : job_.aa;
    const std::uint64_t per_pixel = std::uint64_t{n} * n;
    const std::uint64_t samples = std::uint64_t{job_.width} * job_.height * per_pixel;
    const double weight = 1.0 / static_cast<double>(per_pixel);

    double sum[3] = {};
    bool truncated = false;
    float* rgb = job_.rgb;
    for (std::uint64_t first = 0; first < samples && going_on(); first += block_samples) {
        const auto count =
            static_cast<std::uint32_t>(std::min<std::uint64_t>(block_samples, samples - first));
        draw_block(first, count);
        for (std::uint32_t s = 0; s < count; ++s) {
            for (int c = 0; c < 3; ++c)
                sum[c] += radiance_[3 * s + static_cast<std::uint32_t>(c)];
            truncated |= rays_of_[s] > rays_per_sample_max;
            if ((first + s + 1) % per_pixel != 0)
                continue;
            for (double& component : sum) {
                *rgb++ = as_float(component * weight);
                component = 0;
            }
            result_.counts.truncated_pixels += truncated;
            truncated = false;
        }
    }
    report_now();
    return result_;
}

void TileTracer::draw_block(std::uint64_t first_sample, std::uint32_t count) {
    radiance_.assign(3 * std::size_t{count}, 0.0);
    rays_of_.assign(count, 0);
    const bool seen = job_.cut[0] < 1 || job_.cut[1] < 1 || job_.cut[2] < 1;
    if (job_.depth == 0 || !seen)
        return;
    start_wave(first_sample, count);
    while (going_on()) {
        if (wave_.rays.size() > 0) {
            follow_wave();
        } else {
            if (waiting_.empty())
                break;
            wave_ = std::move(waiting_.back());
            waiting_.pop_back();
        }
    }
    waiting_.clear();
}

void TileTracer::start_wave(std::uint64_t first_sample, std::uint32_t count) {
    wave_.depth = job_.depth;
    wave_.rays.reserve(count);
    for (std::uint32_t i = 0; i < count; ++i) {
        wave_.rays.add();
        wave_.rays.samples()[i] = i;
        ++rays_of_[i];
    }
    for (std::uint32_t i = 0; i < count; i += lanes)
        camera_rays(first_sample + i, i);
    wave_.rays.pad();
    result_.counts.camera += count;
}

/// The rays of some samples, from one on; those beyond the tile's end are never traced.
void TileTracer::camera_rays(std::uint64_t first_sample, std::size_t at) {
    const std::uint64_t n = job_.aa == 0 ? 1 : job_.aa;
    const double dx = 1.0 / static_cast<double>(n * job_.picture_width);
    const double dy = 1.0 / static_cast<double>(n * job_.picture_height);
    Wide x{}, y{};
    for (int lane = 0; lane < lanes; ++lane) {
        const std::uint64_t sample = first_sample + static_cast<std::uint64_t>(lane);
        const std::uint64_t pixel = sample / (n * n), in_pixel = sample % (n * n);
        const auto column = static_cast<double>(job_.x + pixel % job_.width);
        const auto row = static_cast<double>(job_.y + pixel / job_.width);
        if (job_.aa == 0) {
            x[lane] = (column + 0.5) / job_.picture_width;
            y[lane] = (row + 0.5) / job_.picture_height;
        } else { // column by column
            x[lane] =
                (0.5 * dx + column / job_.picture_width) + static_cast<double>(in_pixel / n) * dx;
            y[lane] =
                (0.5 * dy + row / job_.picture_height) + static_cast<double>(in_pixel % n) * dy;
        }
    }
    const CameraTable& camera = tables_.camera;
    const Mask left_eye = x < 0.5;
    if (camera.stereo)
        x = select(left_eye, 2 * x, 2 * x - 1);
    Wide3 place = (all_lanes3(camera.top_left) + x * all_lanes3(camera.rightwards)) +
                  y * all_lanes3(camera.downwards);
    Wide3 dir = normalized(place - all_lanes3(camera.origin));
    const Wide length_squared = dot(dir, dir); // no number where the screen is at the eye
    dir = select((length_squared > 0.5) & (length_squared < 2), dir, all_lanes3(camera.direction));
    if (camera.stereo) {
        const Wide3 aside = all_lanes3(camera.to_left_eye);
        place = place + select(left_eye, aside, -aside);
    }
    RayQueue& rays = wave_.rays;
    store(rays.reals(origin_x) + at, place.x), store(rays.reals(origin_y) + at, place.y);
    store(rays.reals(origin_z) + at, place.z);
    store(rays.reals(dir_x) + at, dir.x), store(rays.reals(dir_y) + at, dir.y);
    store(rays.reals(dir_z) + at, dir.z);
    for (const Column c : {red, green, blue})
        store(rays.reals(c) + at, all_lanes(1.0));
    store(rays.owners() + at, all_lanes(std::int64_t{none}));
    if (tables_.stateful) {
        walker_.find_inside(place, dir);
        for (std::uint32_t w = 0; w < rays.words(); ++w)
            store(rays.inside(w) + at, walker_.bits()[w]);
        const WideInt* const leaves = walker_.find_leaves();
        for (int lane = 0; lane < lanes; ++lane)
            rays.fillers()[at + static_cast<std::size_t>(lane)] =
                filler_of(tables_, LaneSet(leaves, lane));
    }
}

// -------------------------------------------------------------------------------------- the waves

void TileTracer::follow_wave() {
    if (wave_.rays.size() > wave_rays_max)
        split_wave();
    trace();
    if (!going_on())
        return;
    sort_hits();
    shade();
    std::swap(wave_.rays, next_);
    --wave_.depth;
    if (wave_.rays.size() > 0)
        wave_.rays.pad();
}

/// Keeps a part of the wave small enough; the rest waits. A sample with few rays is never divided,
/// and how one with many is divided depends on it alone.
void TileTracer::split_wave() {
    while (wave_.rays.size() > wave_rays_max) {
        const std::size_t n = wave_.rays.size();
        const std::uint32_t* samples = wave_.rays.samples();
        const auto [low, high] = std::minmax_element(samples, samples + n);
        const std::uint32_t middle = *low + (*high - *low) / 2;
        const bool one_sample = *low == *high;
        Wave now{RayQueue(tables_.surface_words), wave_.depth};
        Wave later{RayQueue(tables_.surface_words), wave_.depth};
        now.rays.reserve(n), later.rays.reserve(n);
        for (std::size_t i = 0; i < n; ++i) {
            const bool first_part = one_sample ? i < n / 2 : samples[i] <= middle;
            (first_part ? now : later).rays.add(wave_.rays, i);
        }
        now.rays.pad(), later.rays.pad();
        waiting_.push_back(std::move(later));
        wave_ = std::move(now);
    }
}

void TileTracer::trace() {
    const std::size_t n = wave_.rays.size();
    keys_.resize(n + lanes);
    sides_.resize(n + lanes, {none, none});
    for (std::size_t i = 0; i < n && going_on(); i += lanes) {
        if (tables_.stateful)
            trace_stateful(i);
        else
            trace_stateless(i);
        report(lanes);
    }
    result_.counts.form_tests += std::uint64_t{n} * tables_.surface_count;
}

void TileTracer::trace_stateless(std::size_t i) {
    const Walker::Found found = walker_.first_entry(wave_.rays.rays_at(i), never());
    for (int lane = 0; lane < lanes; ++lane)
        keys_[i + static_cast<std::size_t>(lane)] =
            found.leaf[lane] < 0 ? miss_key()
                                 : key_of(found.surface[lane], found.leaf[lane], false, false);
}

/// The key of a hit: which patch, from which side. A leaf can have a surface twice, inside and
/// outside of it.
std::uint32_t TileTracer::key_of(std::int64_t surface, std::int64_t leaf, bool leaving,
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

void TileTracer::trace_stateful(std::size_t i) {
    RayQueue& rays = wave_.rays;
    WideInt* const bits = walker_.bits();
    for (std::uint32_t w = 0; w < rays.words(); ++w)
        bits[w] = load(rays.inside(w) + i);
    const WideInt filler = load(rays.fillers() + i);
    const Walker::Found found = walker_.first_change(rays.rays_at(i), filler, never());
    const Mask hit = found.leaf >= 0;
    walker_.settle(found, hit);
    for (std::uint32_t w = 0; w < rays.words(); ++w)
        store(rays.inside(w) + i, bits[w]);
    const WideInt* const leaves = walker_.find_leaves();
    const std::size_t used = std::min<std::size_t>(lanes, rays.size() - i);
    for (std::size_t lane = 0; lane < used; ++lane) {
        const std::size_t ray = i + lane;
        const auto l = static_cast<int>(lane);
        if (found.leaf[l] < 0) {
            keys_[ray] = miss_key();
            continue;
        }
        const std::int64_t surface = found.surface[l];
        const bool leaving = found.leaf[l] == filler[l];
        const bool outwards = (bits[surface >> 6][l] >> (surface & 63) & 1) != 0;
        keys_[ray] = key_of(surface, found.leaf[l], leaving, outwards);
        fill(ray, LaneSet(leaves, l), found.leaf[l], surface);
    }
}

/// What fills the space on both sides of a hit. `before`: the leaves just before it.
void TileTracer::fill(std::size_t ray, LaneSet before, std::int64_t leaf, std::int64_t surface) {
    std::int64_t& filler = wave_.rays.fillers()[ray];
    if (filler == unresolved)
        return fail_overlap(before);
    const bool leaving = leaf == filler;
    Sides& sides = sides_[ray];
    if (!leaving && filler == none && tables_.all_relations) {
        sides = {none, static_cast<std::int32_t>(leaf)};
        return;
    }
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
std::uint64_t TileTracer::crossed(std::size_t ray, std::int64_t surface, std::uint32_t w) {
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

/// Stable, by counting.
void TileTracer::sort_hits() {
    const std::size_t n = wave_.rays.size();
    std::fill(key_begin_.begin(), key_begin_.end(), 0u);
    for (std::size_t i = 0; i < n; ++i)
        ++key_begin_[keys_[i] + 1];
    for (std::size_t k = 1; k < key_begin_.size(); ++k)
        key_begin_[k] += key_begin_[k - 1];
    order_.resize(n);
    for (std::size_t i = 0; i < n; ++i)
        order_[key_begin_[keys_[i]]++] = static_cast<std::uint32_t>(i);
}

// ---------------------------------------------------------------------------------------- shading

/// Wide rays at one side of one patch.
struct TileTracer::Incidence {
    const Group& group;
    const Material& material;
    Wide3 dir;
    WideHit hit;      ///< its normal points out of the leaf
    Wide cosine;      ///< of normal and ray
    Wide3 mirror_dir; ///< not normalised
    Wide3 coefficient;
    Wide3 kd;
    WideInt beyond;
};

void TileTracer::shade() {
    next_.reserve(2 * wave_.rays.size());
    const std::size_t n = wave_.rays.size();
    for (std::size_t begin = 0; begin < n && going_on();) {
        const std::uint32_t key = keys_[order_[begin]];
        const std::size_t end = key_begin_[key]; // sort_hits left there where the key ends
        for (std::size_t i = begin; i < end && going_on(); i += lanes) {
            const std::size_t used = std::min<std::size_t>(lanes, end - i);
            std::uint32_t index[lanes];
            for (std::size_t lane = 0; lane < lanes; ++lane)
                index[lane] = order_[i + std::min(lane, used - 1)];
            if (key == miss_key())
                add_background(index, used);
            else
                shade_group(
                    {tables_.patches[key / 2], (key & 1) != 0, index, mask_of((1u << used) - 1)});
        }
        begin = end;
    }
}

void TileTracer::add_background(const std::uint32_t* index, std::size_t count) {
    for (std::size_t lane = 0; lane < count; ++lane) {
        double* radiance = radiance_.data() + 3 * wave_.rays.samples()[index[lane]];
        radiance[0] += tables_.background[0] * wave_.rays.reals(red)[index[lane]];
        radiance[1] += tables_.background[1] * wave_.rays.reals(green)[index[lane]];
        radiance[2] += tables_.background[2] * wave_.rays.reals(blue)[index[lane]];
    }
}

void TileTracer::shade_group(const Group& group) {
    RayQueue& rays = wave_.rays;
    const auto column = [&](Column c) { return gather(rays.reals(c), group.index); };
    const Wide3 origin{column(origin_x), column(origin_y), column(origin_z)};
    const Wide3 dir{column(dir_x), column(dir_y), column(dir_z)};
    const Patch& patch = group.patch;
    const Mask outwards = group.leaving != patch.flipped ? ~Mask{} : Mask{};
    const Mask on_surface =
        gather(rays.owners(), group.index) == all_lanes(std::int64_t{patch.surface});
    WideHit hit = with_surface(tables_, patch.surface, [&](const auto& surface) {
        return hit_on(surface, origin, dir, {outwards, on_surface});
    });
    if (patch.flipped)
        hit.normal = -hit.normal;
    const Material& material =
        tables_.materials[group.leaving ? patch.material_in : patch.material_out];
    const Wide cosine = dot(hit.normal, dir);
    Incidence at{group,
                 material,
                 dir,
                 hit,
                 cosine,
                 dir + (-2 * cosine) * hit.normal,
                 {column(red), column(green), column(blue)},
                 diffuse_at(material, hit.place, tables_.center),
                 {}};
    for (int lane = 0; lane < lanes; ++lane)
        at.beyond[lane] = sides_[group.index[lane]].beyond;

    const Wide3 light = light_on(at) * at.coefficient;
    const auto used = static_cast<std::size_t>(__builtin_popcount(bits_of(group.active)));
    for (std::size_t lane = 0; lane < used; ++lane) {
        double* radiance = radiance_.data() + 3 * rays.samples()[group.index[lane]];
        radiance[0] += light.x[lane], radiance[1] += light.y[lane], radiance[2] += light.z[lane];
    }
    result_.counts.shaded += used;
    send_on(at);
}

Wide3 TileTracer::light_on(const Incidence& at) {
    Wide3 sum = all_lanes3(tables_.ambient) * at.kd;
    if (!at.material.lit)
        return sum;
    for (std::uint32_t i = 0; i < tables_.light_count; ++i) {
        const Light& light = tables_.lights[i];
        Wide3 to_light = all_lanes3(light.to);
        Wide distance = never();
        if (light.point) {
            const Wide3 way = to_light - at.hit.place;
            distance = square_root(dot(way, way));
            to_light = (1.0 / distance) * way;
        }
        Wide cosine = dot(at.hit.normal, to_light);
        if (at.group.leaving)
            cosine = -cosine;
        const Mask lit = lit_by(light, at, to_light, distance, at.group.active & (cosine > 0));
        if (!any(lit))
            continue;
        const Wide3 rgb = all_lanes3(light.rgb);
        Wide3 add = (cosine * rgb) * at.kd;
        if (at.material.shiny) {
            const Wide h = highlight(dot(to_light, at.mirror_dir), at.material.ns);
            add = add + (h * rgb) * all_lanes3(at.material.krl);
        }
        sum = sum + select(lit, add, Wide3{});
    }
    return sum;
}

/// The candidates that see the light.
Mask TileTracer::lit_by(const Light& light, const Incidence& at, Wide3 to_light, Wide distance,
                        Mask candidates) {
    const WideInt filler = gather(wave_.rays.fillers(), at.group.index);
    if (light.within_known) // another volume's light has to cross a surface
        candidates &= filler == all_lanes(std::int64_t{light.within});
    if (!any(candidates))
        return candidates;
    const auto count = static_cast<std::uint64_t>(__builtin_popcount(bits_of(candidates)));
    result_.counts.shadow += count;
    result_.counts.form_tests += count * tables_.surface_count;
    report(count);
    const std::int64_t owner = at.group.patch.surface;
    const WideRays shadow{at.hit.place, to_light, all_lanes(owner)};
    if (!tables_.stateful)
        return candidates & (walker_.first_entry(shadow, distance).leaf < 0);
    for (std::uint32_t w = 0; w < tables_.surface_words; ++w)
        walker_.bits()[w] = gather(wave_.rays.inside(w), at.group.index);
    const Mask blocked = walker_.first_change(shadow, filler, distance).leaf >= 0;
    for (unsigned lost =
             bits_of(blocked & candidates & (filler == all_lanes(std::int64_t{unresolved})));
         lost != 0; lost = 0)
        fail_overlap(LaneSet(walker_.find_leaves(), __builtin_ctz(lost)));
    return candidates & ~blocked;
}

/// The refracted and the reflected rays.
void TileTracer::send_on(const Incidence& at) {
    if (wave_.depth == 1)
        return;
    const Material& m = at.material;
    Wide3 mirrored = all_lanes3(m.krg);
    Wide3 refracted_dir = at.dir, refracted_coefficient{};
    Mask refracts{};
    if (m.glass) {
        const Wide3 ktg = all_lanes3(m.ktg);
        const Mask transmits = at.group.active & ~below_cut(ktg * at.coefficient);
        if (any(transmits)) {
            const Wide index_in = all_lanes(tables_.leaves[at.group.patch.leaf].refractive_index);
            Wide index_out = all_lanes(tables_.ambient_index);
            for (int lane = 0; lane < lanes; ++lane)
                if (at.beyond[lane] >= 0)
                    index_out[lane] = tables_.leaves[at.beyond[lane]].refractive_index;
            const WideRefraction r =
                refract(at.dir, at.hit.normal, at.cosine, at.group.leaving, index_in, index_out);
            const Mask same = index_in == index_out; // nothing bends the ray
            const Wide reflectance = select(same, Wide{}, r.reflectance);
            mirrored = select(transmits, mirrored + reflectance * ktg, mirrored);
            refracted_coefficient = ((1 - reflectance) * ktg) * at.coefficient;
            refracts = transmits & (same | ~r.total) & ~below_cut(refracted_coefficient);
            refracted_dir = select(same, at.dir, normalized(r.dir));
        }
    }
    const Wide3 reflected_coefficient = mirrored * at.coefficient;
    const Mask reflects = at.group.active & ~below_cut(reflected_coefficient);
    const unsigned refracting = bits_of(refracts), reflecting = bits_of(reflects);
    if ((refracting | reflecting) == 0)
        return;
    const Wide3 mirror_dir = normalized(at.mirror_dir);

    RayQueue& rays = wave_.rays;
    const std::uint32_t surface = at.group.patch.surface;
    const auto send = [&](int lane, Wide3 dir, Wide3 coefficient, bool crosses) {
        const std::uint32_t from = at.group.index[lane];
        const std::uint32_t sample = rays.samples()[from];
        if (++rays_of_[sample] > rays_per_sample_max)
            return;
        const std::size_t to = next_.add();
        next_.reals(origin_x)[to] = at.hit.place.x[lane];
        next_.reals(origin_y)[to] = at.hit.place.y[lane];
        next_.reals(origin_z)[to] = at.hit.place.z[lane];
        next_.reals(dir_x)[to] = dir.x[lane];
        next_.reals(dir_y)[to] = dir.y[lane];
        next_.reals(dir_z)[to] = dir.z[lane];
        next_.reals(red)[to] = coefficient.x[lane];
        next_.reals(green)[to] = coefficient.y[lane];
        next_.reals(blue)[to] = coefficient.z[lane];
        next_.owners()[to] = surface;
        next_.fillers()[to] = crosses ? sides_[from].after : rays.fillers()[from];
        next_.samples()[to] = sample;
        for (std::uint32_t w = 0; w < rays.words(); ++w)
            next_.inside(w)[to] = rays.inside(w)[from];
        if (crosses && rays.words() > 0)
            next_.inside(surface >> 6)[to] ^=
                static_cast<std::int64_t>(std::uint64_t{1} << (surface & 63));
        ++(crosses ? result_.counts.refracted : result_.counts.reflected);
    };
    for (unsigned left = refracting | reflecting; left != 0; left &= left - 1) {
        const int lane = __builtin_ctz(left);
        if (refracting >> lane & 1)
            send(lane, refracted_dir, refracted_coefficient, true);
        if (reflecting >> lane & 1)
            send(lane, mirror_dir, reflected_coefficient, false);
    }
}

} // namespace
} // namespace fraja::kernel
