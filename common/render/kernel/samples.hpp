// From samples to camera rays, and wave after wave of what becomes of them.
#pragma once

#include "common/render/kernel/tracer.hpp"

#include <algorithm>
#include <limits>
#include <numeric>

namespace fraja::kernel {
namespace {

template <Features has>
inline void BlockTracer<has>::begin(const SampleJob& job, const Block& block,
                                    const DrawControl& control) {
    job_ = job, block_ = block, control_ = control;
    result_ = {};
    unreported_ = 0;
    spheres_.count_from_zero();
    report_now(); // stopped already?
}

template <Features has>
inline BlockResult BlockTracer<has>::end() {
    report_now();
    result_.counts.box_tests += spheres_.box_tests();
    result_.counts.form_tests += spheres_.form_tests();
    return result_;
}

template <Features has>
inline BlockResult BlockTracer<has>::draw(const SampleJob& job, const Block& block,
                                          const DrawControl& control) {
    begin(job, block, control);
    std::fill_n(block_.rays, block_.count, 1u);
    if (block_.paths != nullptr)
        std::fill_n(block_.paths, block_.count, std::uint64_t{0});
    const bool seen = job_.cut[0] < 1 || job_.cut[1] < 1 || job_.cut[2] < 1;
    const bool draws = job_.depth > 0 && seen;
    std::fill_n(block_.rgb, 3 * std::size_t{block_.count}, 0.0);
    if (block_.lost != nullptr)
        std::fill_n(block_.lost, 3 * std::size_t{block_.count}, draws ? 0.0 : 1.0);
    if (block_.cut != nullptr)
        std::fill_n(block_.cut, 3 * std::size_t{block_.count}, seen ? 0.0 : 1.0);
    if (draws)
        draw_samples();
    return end();
}

template <Features has>
inline void BlockTracer<has>::draw_samples() {
    view_ = look_through();
    result_.skipped = view_ >= View::one_plane;
    if (view_ == View::nothing)
        return show_background();
    start_wave();
    follow_waves();
}

template <Features has>
inline void BlockTracer<has>::show_background() {
    result_.counts.camera += block_.count;
    report(block_.count);
    for (std::size_t i = 0; i < 3 * std::size_t{block_.count}; i += 3)
        for (std::size_t c = 0; c < 3; ++c)
            block_.rgb[i + c] = tables_.background[c];
    if (block_.paths == nullptr)
        return;
    wave_.depth = job_.depth; // as where background is found by a search
    for (std::uint32_t i = 0; i < block_.count; ++i)
        note_path(i, 0);
}

template <Features has>
inline void BlockTracer<has>::start_wave() {
    const std::size_t samples = block_.count;
    if (stateful() && !starts_are_outside())
        walker_.look_at_all();
    wave_.depth = job_.depth;
    wave_.rays.reserve(samples);
    wave_.rays.resize(samples);
    std::iota(wave_.rays.samples(), wave_.rays.samples() + samples, 0u);
    const std::size_t whole = samples / lanes * lanes;
    for (std::size_t i = 0; i < whole; i += lanes)
        camera_rays(load(block_.x + i), load(block_.y + i), i);
    if (whole < samples) {
        Wide x = all_lanes(block_.x[whole]), y = all_lanes(block_.y[whole]);
        for (std::size_t i = whole; i < samples; ++i)
            x[i - whole] = block_.x[i], y[i - whole] = block_.y[i];
        camera_rays(x, y, whole);
    }
    wave_.rays.pad();
    result_.counts.camera += samples;
    if (view_ == View::everything)
        walker_.look_at_all();
    else if (stateful()) // which must be told of every crossing
        walker_.look_along(beam_, none, true);
}

/// FORMAT.md, section 4. Fills a group of the wave's rays.
template <Features has>
inline void BlockTracer<has>::camera_rays(Wide x, const Wide y, std::size_t at) {
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
    store(rays.fillers() + at, all_lanes(std::int64_t{none}));
    if (!stateful())
        return;
    if (starts_are_outside()) {
        for (std::uint32_t w = 0; w < rays.words(); ++w)
            store(rays.inside(w) + at, WideInt{});
        return;
    }
    walker_.find_inside(place, dir);
    for (std::uint32_t w = 0; w < rays.words(); ++w)
        store(rays.inside(w) + at, walker_.bits()[w]);
    const WideInt* const leaves = walker_.find_leaves<has.composites>();
    for (int lane = 0; lane < lanes; ++lane)
        rays.fillers()[at + static_cast<std::size_t>(lane)] =
            filler_of(tables_, LaneSet(leaves, lane));
}

// -------------------------------------------------------------------------------------- the waves

template <Features has>
inline void BlockTracer<has>::follow_waves() {
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

template <Features has>
inline void BlockTracer<has>::follow_wave() {
    if (wave_.rays.size() > wave_rays_max)
        split_wave();
    if (apart() && wave_.depth < job_.depth)
        sort_by_direction();
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

/// Rays that go the same way, by octant, stand together: a packet of them meets the same boxes.
template <Features has>
inline void BlockTracer<has>::sort_by_direction() {
    const std::size_t n = wave_.rays.size();
    const auto octant = [&](std::size_t i) {
        return (wave_.rays.reals(dir_x)[i] < 0 ? 1u : 0u) |
               (wave_.rays.reals(dir_y)[i] < 0 ? 2u : 0u) |
               (wave_.rays.reals(dir_z)[i] < 0 ? 4u : 0u);
    };
    std::size_t begin[9] = {};
    for (std::size_t i = 0; i < n; ++i)
        ++begin[octant(i) + 1];
    for (int o = 0; o < 8; ++o)
        begin[o + 1] += begin[o];
    next_.reserve(n);
    next_.resize(n);
    for (std::size_t i = 0; i < n; ++i)
        next_.put(begin[octant(i)]++, wave_.rays, i);
    std::swap(wave_.rays, next_);
    wave_.rays.pad();
}

/// Keeps a part of the wave small enough; the rest waits. A sample with few rays is never divided,
/// and how one with many is divided depends on it alone.
template <Features has>
inline void BlockTracer<has>::split_wave() {
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

} // namespace
} // namespace fraja::kernel
