// What the camera's rays of a block can meet, told before there are any: nothing, which is
// background; one plane, which all of them meet; or some of what there is.
#pragma once

#include "common/render/kernel/tracer.hpp"

#include <algorithm>

namespace fraja::kernel {
namespace {

/// The rays through a rectangle of the screen; false where nothing useful is known of them: they
/// spread too far, or are seen with two eyes.
inline bool TileTracer::beam_through(const Block& block, Beam& beam) const {
    const CameraTable& camera = tables_.camera;
    const double across[2] = {static_cast<double>(job_.x + block.x) / job_.picture_width,
                              static_cast<double>(job_.x + block.x + block.width) /
                                  job_.picture_width};
    const double down[2] = {static_cast<double>(job_.y + block.y) / job_.picture_height,
                            static_cast<double>(job_.y + block.y + block.height) /
                                job_.picture_height};
    if (camera.stereo && across[0] < 0.5 && across[1] > 0.5)
        return false;
    const bool right_eye = camera.stereo && across[0] >= 0.5;
    struct Way {
        double v[3], length;
    };
    // From the eye to the screen; stereo eyes look the same way.
    const auto way_to = [&](double x, double y) {
        const double u = !camera.stereo ? x : right_eye ? 2 * x - 1 : 2 * x;
        Way way{};
        for (int c = 0; c < 3; ++c)
            way.v[c] = ((camera.top_left[c] + u * camera.rightwards[c]) + y * camera.downwards[c]) -
                       camera.origin[c];
        way.length = __builtin_sqrt(Beam::dot(way.v, way.v));
        return way;
    };
    const Way middle = way_to(0.5 * (across[0] + across[1]), 0.5 * (down[0] + down[1]));
    double magnitudes = 0;
    beam = {};
    for (int c = 0; c < 3; ++c) {
        const double aside =
            camera.stereo ? (right_eye ? -camera.to_left_eye[c] : camera.to_left_eye[c]) : 0;
        beam.dir[c] = middle.v[c] / middle.length;
        beam.start[c] = (camera.origin[c] + middle.v[c]) + aside;
        for (const double x : {camera.top_left[c], camera.rightwards[c], camera.downwards[c],
                               camera.origin[c], aside})
            magnitudes += __builtin_fabs(x);
    }
    // What rounding can do to a place; much more than it does.
    const double slack = 1e-14 * magnitudes;
    double radius = 0, cosine = 1, nearest = middle.length;
    for (const double x : across)
        for (const double y : down) {
            const Way corner = way_to(x, y);
            const double off[3] = {corner.v[0] - middle.v[0], corner.v[1] - middle.v[1],
                                   corner.v[2] - middle.v[2]};
            radius = std::max(radius, __builtin_sqrt(Beam::dot(off, off)));
            cosine = std::min(cosine, Beam::dot(corner.v, beam.dir) / corner.length);
            nearest = std::min(nearest, corner.length);
        }
    // Of a rectangle in a plane, a corner is farthest off any direction.
    nearest -= radius; // of all its points
    if (!(cosine > 0.5) || !(nearest > 0) || !(radius < 1e100))
        return false;
    const double spread = __builtin_sqrt(1 - cosine * cosine + 1e-14) / cosine + slack / nearest;
    // A start may lie behind the beam's, and its ray have spread when it gets there.
    beam.spread = spread;
    beam.radius = (radius + slack) * (1 + spread);
    beam.length = __builtin_inf();
    return true;
}

/// Turns the search to what the rays of a block may meet.
inline TileTracer::View TileTracer::look_through(const Block& block) {
    spheres_in_view_ = tables_.bvh != nullptr;
    if (!tables_.camera_is_outside || !beam_through(block, beam_))
        return View::everything;
    spheres_in_view_ = spheres_in_view_ && spheres_.may_meet(beam_);
    if (!walker_.look_along(beam_, none, false) && !spheres_in_view_)
        return View::nothing;
    // What else depends on a hit, rays with state would have to be told.
    const bool told = !tables_.stateful || tables_.leaf_is_surface;
    if (told && !spheres_in_view_)
        if (const std::int32_t plane = walker_.only_plane();
            plane != none &&
            beam_.surely_meets(
                tables_.planes[static_cast<std::uint32_t>(plane) - tables_.sphere_count])) {
            plane_in_view_ = plane;
            return View::one_plane;
        }
    return View::some;
}

/// All rays of the wave meet the plane.
inline void TileTracer::meet_plane(std::int32_t plane) {
    const std::size_t n = wave_.rays.size();
    keys_.assign(n + packet_rays, tables_.entry_keys[plane]);
    sides_.assign(n + packet_rays,
                  {none, tables_.stateful ? tables_.leaf_of_surface[plane] : none});
    report(n);
}

} // namespace
} // namespace fraja::kernel
