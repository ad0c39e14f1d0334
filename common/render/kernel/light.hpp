// The light that a wave's hits send back, and the rays they send on. FORMAT.md, section 6.
#pragma once

#include "common/base/rng.hpp"
#include "common/render/kernel/tracer.hpp"

#include <algorithm>
#include <bit>

namespace fraja::kernel {
namespace {

template <Features has>
inline BlockTracer<has>::BlockTracer(const Tables& tables)
    : tables_(tables), scene_(tables.scene), walker_(tables),
      spheres_(tables), wave_{RayQueue(tables.surface_words)}, next_(tables.surface_words),
      batch_(batch_rays / lanes) {}

template <Features has>
inline void BlockTracer<has>::shade() {
    next_.reserve(2 * wave_.rays.size());
    const std::size_t n = wave_.rays.size();
    for (std::size_t begin = 0; begin < n && going_on();) {
        const std::uint32_t key = keys_[order_[begin]];
        std::size_t end = begin + 1;
        while (end < n && keys_[order_[end]] == key)
            ++end;
        if (key == miss_key())
            add_background(order_.data() + begin, end - begin);
        else
            for (std::size_t i = begin; i < end && going_on(); i += batch_rays)
                shade_batch(key, order_.data() + i, std::min(batch_rays, end - i));
        begin = end;
    }
}

template <Features has>
inline void BlockTracer<has>::add_background(const std::uint32_t* index, std::size_t count) {
    RayQueue& rays = wave_.rays;
    if (first_hits_ != nullptr)
        return;
    for (std::size_t i = 0; i < count; ++i) {
        double* radiance = block_.rgb + 3 * rays.samples()[index[i]];
        radiance[0] += tables_.background[0] * rays.reals(red)[index[i]];
        radiance[1] += tables_.background[1] * rays.reals(green)[index[i]];
        radiance[2] += tables_.background[2] * rays.reals(blue)[index[i]];
        if (block_.paths != nullptr)
            note_path(rays.samples()[index[i]], 0);
    }
}

template <Features has>
inline void BlockTracer<has>::shade_batch(std::uint32_t key, const std::uint32_t* index,
                                          std::size_t count) {
    const std::size_t groups = (count + lanes - 1) / lanes;
    std::uint32_t padded[batch_rays + lanes];
    for (std::size_t i = 0; i < groups * lanes; ++i)
        padded[i] = index[std::min(i, count - 1)];
    const bool apart = has.apart && key >= patch_keys();
    const Patch* const patch = apart ? nullptr : tables_.patches + key / 2;
    const bool leaving = has.state && !apart && (key & 1) != 0;
    const std::uint32_t material = apart     ? key - patch_keys()
                                   : leaving ? patch->material_in
                                             : patch->material_out;
    for (std::size_t g = 0; g < groups; ++g) {
        const std::size_t used = std::min<std::size_t>(lanes, count - lanes * g);
        batch_[g] = meet({patch, tables_.materials + material, leaving, padded + lanes * g,
                          mask_of((1u << used) - 1)});
    }
    if (first_hits_ != nullptr)
        return note_first_hits(groups);
    result_.counts.shaded += count;
    add_light(groups);
    if (wave_.depth > 1 || block_.lost != nullptr)
        for (std::size_t g = 0; g < groups; ++g)
            send_on(batch_[g]);
}

template <Features has>
inline Incidence BlockTracer<has>::meet(const Group& group) {
    RayQueue& rays = wave_.rays;
    const auto column = [&](Column c) { return gather(rays.reals(c), group.index); };
    const Wide3 origin{column(origin_x), column(origin_y), column(origin_z)};
    const Wide3 dir{column(dir_x), column(dir_y), column(dir_z)};
    const WideInt owner = gather(rays.owners(), group.index);
    Incidence at{};
    at.group = group;
    at.dir = dir;
    at.coefficient = {column(red), column(green), column(blue)};
    if (const Patch* patch = group.patch; !has.apart || patch) {
        at.owner = all_lanes(std::int64_t{patch->surface});
        const Mask outwards = group.leaving != patch->flipped ? ~Mask{} : Mask{};
        at.hit = with_surface(tables_, patch->surface, [&](const auto& surface) {
            return hit_on(surface, origin, dir, {outwards, owner == at.owner});
        });
        if (patch->flipped)
            at.hit.normal = -at.hit.normal;
    } else {
        WideSphere spheres{};
        for (int lane = 0; lane < lanes; ++lane) {
            const std::uint32_t sphere = spheres_met_[group.index[lane]];
            const SphereSurface& s = tables_.bvh_spheres[sphere];
            spheres.center.x[lane] = s.center[0], spheres.center.y[lane] = s.center[1];
            spheres.center.z[lane] = s.center[2], spheres.radius[lane] = s.radius;
            at.owner[lane] = std::int64_t{tables_.surface_count} + sphere;
        }
        at.hit = hit_on(spheres, origin, dir, {Mask{}, owner == at.owner});
    }
    at.cosine = dot(at.hit.normal, dir);
    at.mirror_dir = dir + (-2 * at.cosine) * at.hit.normal;
    return at;
}

/// A surface that nothing lights needs no texture.
template <Features has>
inline const Wide3& BlockTracer<has>::diffuse(Incidence& at) {
    if (!at.textured)
        at.kd = diffuse_at(*at.group.material, at.hit.place, tables_.center);
    at.textured = true;
    return at.kd;
}

/// Local light (6.3), times what becomes of it on the way to the eye.
template <Features has>
inline void BlockTracer<has>::add_light(std::size_t groups) {
    const Material& material = *batch_[0].group.material;
    if (tables_.any_ambient)
        for (std::size_t g = 0; g < groups; ++g)
            batch_[g].light = all_lanes3(tables_.ambient) * diffuse(batch_[g]);
    for (std::uint32_t i = 0; i < tables_.light_count && material.lit; ++i) {
        const Light& light = tables_.lights[i];
        const bool may_be_shadowed = look_towards(light, groups);
        for (std::size_t g = 0; g < groups; g += packet_groups)
            add_light_of(light, g, std::min<std::size_t>(packet_groups, groups - g),
                         may_be_shadowed);
    }
    for (std::size_t g = 0; g < groups; ++g) {
        const Incidence& at = batch_[g];
        const Wide3 light = at.light * at.coefficient;
        const auto used = __builtin_popcount(bits_of(at.group.active));
        for (int lane = 0; lane < used; ++lane) {
            double* radiance = block_.rgb + 3 * wave_.rays.samples()[at.group.index[lane]];
            radiance[0] += light.x[lane], radiance[1] += light.y[lane];
            radiance[2] += light.z[lane];
        }
        if (block_.paths != nullptr)
            note_paths(at);
    }
}

/// What was hit, in which field of a chequer, and which lights light it.
template <Features has>
inline void BlockTracer<has>::note_paths(const Incidence& at) {
    const Material& material = *at.group.material;
    const bool chequered = at.textured && material.pattern != Material::Pattern::plain;
    Wide i{}, j{};
    if (chequered)
        fields_at(material, at.hit.place, tables_.center, i, j);
    for (unsigned left = bits_of(at.group.active); left != 0; left &= left - 1) {
        const int lane = __builtin_ctz(left);
        std::uint64_t what = 2 * static_cast<std::uint64_t>(at.owner[lane]) + at.group.leaving;
        what ^= static_cast<std::uint64_t>(at.path[lane]);
        if (chequered)
            what = Rng(Rng(what + std::bit_cast<std::uint64_t>(i[lane])).next() +
                       std::bit_cast<std::uint64_t>(j[lane]))
                       .next();
        note_path(wave_.rays.samples()[at.group.index[lane]], what + 1);
    }
}

/// Adds to a sample's path; what it is made of may be added in any order.
template <Features has>
inline void BlockTracer<has>::note_path(std::uint32_t sample, std::uint64_t what) {
    block_.paths[sample] += Rng(what + wave_.depth * 0x9e3779b97f4a7c15).next();
}

/// Has the walker look at what may stand between a batch and a light; whether there is anything.
template <Features has>
inline bool BlockTracer<has>::look_towards(const Light& light, std::size_t groups) {
    const auto owner = batch_[0].group.patch ? std::int64_t{batch_[0].group.patch->surface} : none;
    Wide3 low = batch_[0].hit.place, high = low;
    Mask outside = ~Mask{}; // of everything
    for (std::size_t g = 0; g < groups; ++g) {
        const Wide3& p = batch_[g].hit.place;
        low = {lesser(p.x, low.x), lesser(p.y, low.y), lesser(p.z, low.z)};
        high = {greater(p.x, high.x), greater(p.y, high.y), greater(p.z, high.z)};
        if (stateful())
            outside &= gather(wave_.rays.fillers(), batch_[g].group.index) ==
                       all_lanes(std::int64_t{none});
    }
    if (any(~outside)) {
        walker_.look_at_all();
        return true;
    }
    Beam beam{};
    double diagonal_squared = 0, length_squared = 0;
    const Wide* const lows[] = {&low.x, &low.y, &low.z};
    const Wide* const highs[] = {&high.x, &high.y, &high.z};
    for (int c = 0; c < 3; ++c) {
        double least = (*lows[c])[0], most = (*highs[c])[0];
        for (int lane = 1; lane < lanes; ++lane) {
            least = (*lows[c])[lane] < least ? (*lows[c])[lane] : least;
            most = (*highs[c])[lane] > most ? (*highs[c])[lane] : most;
        }
        beam.start[c] = 0.5 * (least + most);
        diagonal_squared += (most - least) * (most - least);
        beam.dir[c] = light.point ? light.to[c] - beam.start[c] : light.to[c];
        length_squared += beam.dir[c] * beam.dir[c];
    }
    beam.radius = 0.5 * __builtin_sqrt(diagonal_squared);
    beam.length = light.point ? __builtin_sqrt(length_squared) : __builtin_inf();
    if (light.point)
        for (double& component : beam.dir)
            component /= beam.length;
    if (!(length_squared > 1e-280)) { // at the light, or absurd
        walker_.look_at_all();
        return true;
    }
    return walker_.look_along(beam, owner, false);
}

/// A light on some groups of the batch.
template <Features has>
inline void BlockTracer<has>::add_light_of(const Light& light, std::size_t first,
                                           std::size_t groups, bool may_be_shadowed) {
    Incidence* const at = batch_.data() + first;
    const Material& material = *at->group.material;
    Packet shadows;
    Wide cosine[packet_groups];
    Mask lit[packet_groups];
    for (std::size_t g = 0; g < groups; ++g) {
        Wide3 to_light = all_lanes3(light.to);
        shadows.t[g] = never();
        if (light.point) {
            const Wide3 way = to_light - at[g].hit.place;
            shadows.t[g] = square_root(dot(way, way));
            to_light = (1.0 / shadows.t[g]) * way;
        }
        shadows.rays[g] = {at[g].hit.place, to_light, at[g].owner};
        cosine[g] = dot(at[g].hit.normal, to_light);
        if (at->group.leaving)
            cosine[g] = -cosine[g];
        // At a right angle only a highlight shows.
        lit[g] = at[g].group.active & (material.shiny ? cosine[g] >= 0 : cosine[g] > 0);
    }
    if (light.within_known) // another volume's light has to cross a surface
        for (std::size_t g = 0; g < groups; ++g)
            lit[g] &= gather(wave_.rays.fillers(), at[g].group.index) ==
                      all_lanes(std::int64_t{light.within});
    std::uint64_t asked = 0;
    for (std::size_t g = 0; g < groups; ++g)
        asked += static_cast<unsigned>(__builtin_popcount(bits_of(lit[g])));
    result_.counts.shadow += asked;
    report(asked);
    if (may_be_shadowed || apart())
        cast_shadows(at, groups, shadows, lit);
    if (block_.paths != nullptr) {
        const auto number = static_cast<std::uint64_t>(&light - tables_.lights) + 1;
        for (std::size_t g = 0; g < groups; ++g)
            at[g].path ^=
                lit[g] & all_lanes(static_cast<std::int64_t>(number * 0x9e3779b97f4a7c15));
    }
    const Wide3 rgb = all_lanes3(light.rgb);
    for (std::size_t g = 0; g < groups; ++g) {
        if (!any(lit[g]))
            continue;
        Wide3 add = (cosine[g] * rgb) * diffuse(at[g]);
        if (material.shiny) {
            const Wide h = highlight(dot(shadows.rays[g].dir, at[g].mirror_dir), material.ns);
            add = add + (h * rgb) * all_lanes3(material.krl);
        }
        at[g].light = at[g].light + select(lit[g], add, Wide3{});
    }
}

/// Of the lanes that a light could light, leaves those that it does.
template <Features has>
inline void BlockTracer<has>::cast_shadows(const Incidence* at, std::size_t groups, Packet& shadows,
                                           Mask* lit) {
    std::uint64_t count = 0;
    unsigned outside = 0;
    for (std::size_t g = 0; g < groups; ++g) {
        if (!any(lit[g]))
            continue;
        WideInt filler = all_lanes(std::int64_t{none});
        if (stateful())
            filler = gather(wave_.rays.fillers(), at[g].group.index);
        count += static_cast<unsigned>(__builtin_popcount(bits_of(lit[g])));
        const Mask inside = lit[g] & (filler != all_lanes(std::int64_t{none}));
        if (!stateful() || (!composites() && !any(inside)))
            lit[g] &=
                ~walker_.meets_anything<has.composites>(shadows.rays[g], lit[g], shadows.t[g]);
        else if constexpr (has.state)
            cast_within(at[g], shadows.rays[g], shadows.t[g], filler, lit[g]);
        outside |= bits_of(lit[g] & (filler == all_lanes(std::int64_t{none}))) << (g * lanes);
    }
    result_.counts.form_tests += count * walker_.surfaces_in_view();
    if (!apart() || outside == 0)
        return;
    for (std::size_t g = groups; g < packet_groups; ++g) // not looked at, but read
        shadows.rays[g] = shadows.rays[0], shadows.t[g] = shadows.t[0];
    const unsigned blocked = spheres_.find_blocked(shadows, outside);
    for (std::size_t g = 0; g < groups; ++g)
        lit[g] &= ~mask_of(blocked >> (g * lanes) & every_lane);
}

/// Likewise, of rays of which some are in something.
template <Features has>
inline void BlockTracer<has>::cast_within(const Incidence& at, const WideRays& rays, Wide limit,
                                          WideInt filler, Mask& lit) {
    for (std::uint32_t w = 0; w < tables_.surface_words; ++w)
        walker_.bits()[w] = gather(wave_.rays.inside(w), at.group.index);
    const Mask blocked = walker_.first_change<has.composites>(rays, filler, limit).leaf >= 0;
    const unsigned lost = bits_of(blocked & lit & (filler == all_lanes(std::int64_t{unresolved})));
    if (lost != 0)
        fail_overlap(LaneSet(walker_.find_leaves<has.composites>(), __builtin_ctz(lost)));
    lit &= ~blocked;
}

/// The refracted and the reflected rays.
template <Features has>
inline void BlockTracer<has>::send_on(const Incidence& at) {
    const Material& m = *at.group.material;
    Wide3 mirrored = all_lanes3(m.krg);
    Wide3 refracted_dir = at.dir, refracted_coefficient{};
    Mask refracts{};
    if constexpr (has.state)
        if (m.glass)
            refracts = pass_through(at, mirrored, refracted_dir, refracted_coefficient);
    const Wide3 reflected_coefficient = mirrored * at.coefficient;
    const Mask reflects = at.group.active & ~below_cut(reflected_coefficient);
    if (block_.lost != nullptr || block_.cut != nullptr) {
        lose(at, at.group.active & ~refracts, refracted_coefficient);
        lose(at, at.group.active & ~reflects, reflected_coefficient);
    }
    const unsigned refracting = bits_of(refracts), reflecting = bits_of(reflects);
    if ((refracting | reflecting) == 0)
        return;
    const Wide3 mirror_dir = normalized(at.mirror_dir);
    // A lane's refracted ray before its reflected one: the order that sums follow.
    for (unsigned left = refracting | reflecting; left != 0; left &= left - 1) {
        const int lane = __builtin_ctz(left);
        if (refracting >> lane & 1)
            send(at, lane, refracted_dir, refracted_coefficient, true);
        if (reflecting >> lane & 1)
            send(at, lane, mirror_dir, reflected_coefficient, false);
    }
}

/// The rays that glass lets through, where they go and what they count; what it reflects beside.
template <Features has>
inline Mask BlockTracer<has>::pass_through(const Incidence& at, Wide3& mirrored, Wide3& dir,
                                           Wide3& coefficient) {
    const Wide3 ktg = all_lanes3(at.group.material->ktg);
    coefficient = ktg * at.coefficient;
    const Mask transmits = at.group.active & ~below_cut(coefficient);
    if (!any(transmits))
        return transmits;
    const Wide index_in = all_lanes(tables_.leaves[at.group.patch->leaf].refractive_index);
    Wide index_out = all_lanes(tables_.ambient_index);
    for (int lane = 0; lane < lanes; ++lane)
        if (const std::int32_t beyond = sides_[at.group.index[lane]].beyond; beyond >= 0)
            index_out[lane] = tables_.leaves[beyond].refractive_index;
    const WideRefraction r =
        refract(at.dir, at.hit.normal, at.cosine, at.group.leaving, index_in, index_out);
    const Mask same = index_in == index_out; // nothing bends the ray
    const Wide reflectance = select(same, Wide{}, r.reflectance);
    mirrored = select(transmits, mirrored + reflectance * ktg, mirrored);
    coefficient = select(transmits, ((1 - reflectance) * ktg) * at.coefficient, coefficient);
    dir = select(same, at.dir, normalized(r.dir));
    return transmits & (same | ~r.total) & ~below_cut(coefficient);
}

/// One ray into the next wave, if depth and budget allow it.
template <Features has>
FRAJA_WIDE void BlockTracer<has>::send(const Incidence& at, int lane, const Wide3& dir,
                                       const Wide3& coefficient, bool crosses) {
    RayQueue& rays = wave_.rays;
    const std::uint32_t from = at.group.index[lane];
    const std::uint32_t sample = rays.samples()[from];
    if (wave_.depth == 1)
        return add_weight(block_.lost, sample, coefficient, lane);
    if (++block_.rays[sample] > rays_per_sample_max) {
        result_.budget_spent = true;
        return add_weight(block_.lost, sample, coefficient, lane);
    }
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
    next_.owners()[to] = at.owner[lane];
    next_.samples()[to] = sample;
    if constexpr (!has.state)
        return void(++result_.counts.reflected);
    next_.fillers()[to] = crosses ? sides_[from].after : rays.fillers()[from];
    for (std::uint32_t w = 0; w < rays.words(); ++w)
        next_.inside(w)[to] = rays.inside(w)[from];
    if (crosses) { // which only rays with state do
        const std::uint32_t surface = at.group.patch->surface;
        next_.inside(surface >> 6)[to] ^=
            static_cast<std::int64_t>(std::uint64_t{1} << (surface & 63));
    }
    ++(crosses ? result_.counts.refracted : result_.counts.reflected);
}

/// Notes the weight of rays below the cut level.
template <Features has>
inline void BlockTracer<has>::lose(const Incidence& at, Mask rays, const Wide3& coefficient) {
    for (unsigned left = bits_of(rays); left != 0; left &= left - 1) {
        const int lane = __builtin_ctz(left);
        const std::uint32_t sample = wave_.rays.samples()[at.group.index[lane]];
        add_weight(block_.lost, sample, coefficient, lane);
        if (wave_.depth > 1)
            add_weight(block_.cut, sample, coefficient, lane);
    }
}

} // namespace
} // namespace fraja::kernel
