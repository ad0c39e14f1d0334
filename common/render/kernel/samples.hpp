// From a tile to camera rays, and from samples to pixels.
#pragma once

#include "common/render/kernel/tracer.hpp"

#include <algorithm>
#include <limits>
#include <numeric>

namespace fraja::kernel {
namespace {

/// The last guard: absurd colours (1e300 times 1e300) must not put into a picture what is no
/// number.
inline float as_float(double radiance) {
    constexpr double most = static_cast<double>(std::numeric_limits<float>::max());
    const double positive = radiance > 0 ? radiance : 0;
    return static_cast<float>(positive < most ? positive : most);
}

/// Blocks are as square as they can be, so that their rays go the same way.
inline std::uint32_t block_side(std::uint64_t samples_per_pixel) {
    std::uint32_t side = block_side_max;
    while (side > 1 && side * side * samples_per_pixel > block_samples_max)
        side /= 2;
    return side;
}

template <Features has>
inline TileResult TileTracer<has>::draw(const TileJob& job, const TileControl& control) {
    job_ = job, control_ = control;
    result_ = {};
    unreported_ = 0;
    for (int c = 0; c < 3; ++c) // of a tile that was stopped
        pixel_sum_[c] = pixel_lost_[c] = 0;
    pixel_truncated_ = budget_spent_ = background_known_ = false;
    spheres_.count_from_zero();
    report_now(); // stopped already?
    const std::uint64_t per_pixel = samples_per_pixel();
    const std::uint32_t side = block_side(per_pixel);
    for (std::uint32_t y = 0; y < job_.height; y += side)
        for (std::uint32_t x = 0; x < job_.width; x += side)
            for (std::uint64_t first = 0; first < per_pixel && going_on();
                 first += block_samples_max)
                draw_block({x, y, std::min(side, job_.width - x), std::min(side, job_.height - y),
                            first, std::min<std::uint64_t>(per_pixel - first, block_samples_max)});
    report_now();
    result_.counts.box_tests += spheres_.box_tests();
    result_.counts.form_tests += spheres_.form_tests();
    return result_;
}

/// Calls f(column, row) for the pixels of a block in squares of four by four: a packet's, where a
/// pixel has one sample.
template <class F>
inline void for_each_pixel(const Block& block, F&& f) {
    constexpr std::uint32_t side = 4;
    for (std::uint32_t y = 0; y < block.height; y += side)
        for (std::uint32_t x = 0; x < block.width; x += side)
            for (std::uint32_t row = y; row < std::min(y + side, block.height); ++row)
                for (std::uint32_t column = x; column < std::min(x + side, block.width); ++column)
                    f(block.x + column, block.y + row);
}

template <Features has>
inline void TileTracer<has>::draw_block(const Block& block) {
    const bool seen = job_.cut[0] < 1 || job_.cut[1] < 1 || job_.cut[2] < 1;
    const bool draws = job_.depth > 0 && seen;
    if (draws)
        view_ = look_through(block);
    if (draws && view_ >= View::one_plane && block.first == 0)
        result_.counts.skipped_pixels += std::uint64_t{block.width} * block.height;
    if (draws && view_ == View::nothing)
        return show_background(block);
    const std::size_t samples =
        std::size_t{block.width} * block.height * static_cast<std::size_t>(block.count);
    radiance_.assign(3 * samples, 0.0);
    rays_of_.assign(samples, 1);
    if (job_.truncated != nullptr)
        lost_.assign(3 * samples, draws ? 0.0 : 1.0);
    if (draws) {
        start_wave(block);
        follow_waves();
    }
    collect(block);
}

/// From samples to pixels; of a pixel whose samples are in several blocks with the last.
template <Features has>
inline void TileTracer<has>::collect(const Block& block) {
    const std::uint64_t per_pixel = samples_per_pixel();
    const double weight = 1.0 / static_cast<double>(per_pixel);
    const bool last = block.first + block.count == per_pixel;
    std::size_t sample = 0;
    for_each_pixel(block, [&](std::uint32_t column, std::uint32_t row) {
        const std::size_t pixel = std::size_t{row} * job_.width + column;
        float* const rgb = job_.rgb + 3 * pixel;
        double sum[3] = {pixel_sum_[0], pixel_sum_[1], pixel_sum_[2]};
        const double* radiance = radiance_.data() + 3 * sample;
        for (std::uint64_t i = 0; i < block.count; ++i, radiance += 3)
            sum[0] += radiance[0], sum[1] += radiance[1], sum[2] += radiance[2];
        if (last)
            for (int c = 0; c < 3; ++c)
                rgb[c] = as_float(sum[c] * weight);
        if (per_pixel > block.count)
            for (int c = 0; c < 3; ++c)
                pixel_sum_[c] = last ? 0 : sum[c];
        if (budget_spent_)
            count_truncated(block, sample, last);
        if (job_.truncated != nullptr)
            collect_lost(block, sample, last ? job_.truncated + pixel : nullptr, weight);
        sample += block.count;
    });
    budget_spent_ = budget_spent_ && !last;
}

template <Features has>
inline void TileTracer<has>::count_truncated(const Block& block, std::size_t sample, bool last) {
    for (std::uint64_t i = 0; i < block.count; ++i)
        pixel_truncated_ |= rays_of_[sample + i] > rays_per_sample_max;
    if (!last)
        return;
    result_.counts.truncated_pixels += pixel_truncated_;
    pixel_truncated_ = false;
}

/// Of a pixel's samples; `to`: its place, with its last ones.
template <Features has>
inline void TileTracer<has>::collect_lost(const Block& block, std::size_t sample, float* to,
                                          double weight) {
    for (std::uint64_t i = 0; i < block.count; ++i)
        for (std::size_t c = 0; c < 3; ++c)
            pixel_lost_[c] += lost_[3 * (sample + i) + c];
    if (to == nullptr)
        return;
    *to = as_float(*std::max_element(pixel_lost_, pixel_lost_ + 3) * weight);
    std::fill(pixel_lost_, pixel_lost_ + 3, 0.0);
}

/// Where the camera's rays meet nothing, all pixels are the same, with all their samples.
template <Features has>
inline void TileTracer<has>::show_background(const Block& block) {
    const std::uint64_t samples = std::uint64_t{block.width} * block.height * block.count;
    result_.counts.camera += samples;
    report(samples);
    if (block.first > 0)
        return; // they are drawn already
    if (!background_known_) {
        const std::uint64_t per_pixel = samples_per_pixel();
        const double weight = 1.0 / static_cast<double>(per_pixel);
        for (std::size_t c = 0; c < 3; ++c) {
            double sum = 0;
            for (std::uint64_t i = 0; i < per_pixel; ++i)
                sum += tables_.background[c];
            background_[c] = as_float(sum * weight);
        }
        background_known_ = true;
    }
    for (std::uint32_t y = block.y; y < block.y + block.height; ++y) {
        const std::size_t first = std::size_t{y} * job_.width + block.x;
        float* rgb = job_.rgb + 3 * first;
        for (std::uint32_t x = 0; x < block.width; ++x, rgb += 3)
            rgb[0] = background_[0], rgb[1] = background_[1], rgb[2] = background_[2];
        if (job_.truncated != nullptr)
            std::fill(job_.truncated + first, job_.truncated + first + block.width, 0.0F);
    }
}

/// Raja's samples: a pixel's centre, or a regular grid, column by column. FORMAT.md, section 5.
template <Features has>
inline void TileTracer<has>::place_samples(const Block& block) {
    const std::uint64_t n = job_.aa == 0 ? 1 : job_.aa;
    const double dx = 1.0 / static_cast<double>(n * job_.picture_width);
    const double dy = 1.0 / static_cast<double>(n * job_.picture_height);
    double pixel_x[block_side_max], pixel_y[block_side_max];
    const auto place = [&](std::uint32_t pixel, std::uint32_t size, double step) {
        const auto edge = static_cast<double>(pixel);
        return job_.aa == 0 ? (edge + 0.5) / size : 0.5 * step + edge / size;
    };
    for (std::uint32_t i = 0; i < block.width; ++i)
        pixel_x[i] = place(job_.x + block.x + i, job_.picture_width, dx);
    for (std::uint32_t i = 0; i < block.height; ++i)
        pixel_y[i] = place(job_.y + block.y + i, job_.picture_height, dy);
    const std::size_t samples = rays_of_.size();
    sample_x_.resize(samples + lanes), sample_y_.resize(samples + lanes);
    double *x = sample_x_.data(), *y = sample_y_.data();
    for_each_pixel(block, [&](std::uint32_t column, std::uint32_t row) {
        const double left = pixel_x[column - block.x], top = pixel_y[row - block.y];
        if (job_.aa == 0) {
            *x++ = left, *y++ = top;
            return;
        }
        std::uint64_t kx = block.first / n, ky = block.first % n;
        for (std::uint64_t i = 0; i < block.count; ++i) {
            *x++ = left + static_cast<double>(kx) * dx;
            *y++ = top + static_cast<double>(ky) * dy;
            if (++ky == n)
                ky = 0, ++kx;
        }
    });
    std::fill(x, x + lanes, 0.5), std::fill(y, y + lanes, 0.5); // in lanes that are not used
}

template <Features has>
inline void TileTracer<has>::start_wave(const Block& block) {
    const std::size_t samples = rays_of_.size();
    if (stateful() && !starts_are_outside())
        walker_.look_at_all();
    wave_.depth = job_.depth;
    wave_.rays.reserve(samples);
    wave_.rays.resize(samples);
    std::iota(wave_.rays.samples(), wave_.rays.samples() + samples, 0u);
    place_samples(block);
    for (std::size_t i = 0; i < samples; i += lanes)
        camera_rays(load(sample_x_.data() + i), load(sample_y_.data() + i), i);
    wave_.rays.pad();
    result_.counts.camera += samples;
    if (view_ == View::everything)
        walker_.look_at_all();
    else if (stateful()) // which must be told of every crossing
        walker_.look_along(beam_, none, true);
}

/// FORMAT.md, section 4. Fills a group of the wave's rays.
template <Features has>
inline void TileTracer<has>::camera_rays(Wide x, const Wide y, std::size_t at) {
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
inline void TileTracer<has>::follow_waves() {
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
inline void TileTracer<has>::follow_wave() {
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
inline void TileTracer<has>::sort_by_direction() {
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
inline void TileTracer<has>::split_wave() {
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
