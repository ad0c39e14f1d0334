// What camera rays meet first, without any light.
#pragma once

#include "common/render/kernel/tracer.hpp"

#include <algorithm>

namespace fraja::kernel {
namespace {

template <Features has>
inline BlockResult BlockTracer<has>::find_first_hits(const FirstHits& block,
                                                     const DrawControl& control) {
    Block places{};
    places.count = block.count, places.x = block.x, places.y = block.y;
    begin({.depth = 1, .cut = {}}, places, control);
    std::fill_n(block.hits, block.count, TableHit{{}, {}, none});
    view_ = look_through();
    if (view_ == View::nothing) {
        result_.counts.camera += block.count;
        report(block.count);
        return end();
    }
    start_wave();
    trace();
    if (going_on()) {
        sort_hits();
        first_hits_ = block.hits;
        shade();
        first_hits_ = nullptr;
    }
    return end();
}

/// In place of the batch's light.
template <Features has>
inline void BlockTracer<has>::note_first_hits(std::size_t groups) {
    std::for_each_n(batch_.begin(), groups, [&](const Incidence& at) {
        const Patch* const patch = at.group.patch;
        const WideHit& hit = at.hit;
        for (unsigned left = bits_of(at.group.active); left != 0; left &= left - 1) {
            const int lane = __builtin_ctz(left);
            first_hits_[wave_.rays.samples()[at.group.index[lane]]] = {
                {hit.place.x[lane], hit.place.y[lane], hit.place.z[lane]},
                {hit.normal.x[lane], hit.normal.y[lane], hit.normal.z[lane]},
                patch ? std::int64_t{patch->leaf}
                      : at.owner[lane] - tables_.surface_count + tables_.leaf_count};
        }
    });
}

} // namespace
} // namespace fraja::kernel
