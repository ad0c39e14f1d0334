// What the camera's rays of a block can meet, told before there are any: nothing, which is
// background; one plane, which all of them meet; or some of what there is.
#pragma once

#include "common/render/kernel/tracer.hpp"

#include <algorithm>

namespace fraja::kernel {
namespace {

/// Turns the search to what the rays of a block may meet.
template <Features has>
inline View BlockTracer<has>::look_through() {
    spheres_in_view_ = apart();
    const auto [left, right] = std::minmax_element(block_.x, block_.x + block_.count);
    const auto [top, bottom] = std::minmax_element(block_.y, block_.y + block_.count);
    const double across[2] = {*left, *right}, down[2] = {*top, *bottom};
    if (!tables_.camera_is_outside || !beam_through(tables_.camera, across, down, beam_))
        return View::everything;
    spheres_in_view_ = spheres_in_view_ && spheres_.may_meet(beam_);
    if (!walker_.look_along(beam_, none, false) && !spheres_in_view_)
        return View::nothing;
    // What else depends on a hit, rays with state would have to be told.
    const bool told = !stateful() || starts_are_outside();
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
template <Features has>
inline void BlockTracer<has>::meet_plane(std::int32_t plane) {
    const std::size_t n = wave_.rays.size();
    keys_.assign(n + packet_rays, tables_.entry_keys[plane]);
    sides_.assign(n + packet_rays, {none, stateful() ? tables_.leaf_of_surface[plane] : none});
    report(n);
}

} // namespace
} // namespace fraja::kernel
