// The search for hits alone, for measuring: as a wave does it, without all that surrounds it there.
#pragma once

#include "common/render/kernel/packet.hpp"
#include "common/render/kernel/tables.hpp"
#include "common/render/kernel/walk.hpp"

namespace fraja::kernel {
namespace {

/// Of a scene whose rays carry no state.
template <bool composites>
void find_hits_with(const Tables& tables, const RayBatch& batch) {
    Walker walker(tables);
    PacketTracer spheres(tables);
    Packet packet;
    for (std::size_t i = 0; i < batch.count; i += packet_rays) {
        for (std::size_t g = 0; g < packet_groups; ++g) {
            const std::size_t at = i + g * lanes;
            const auto triple = [&](const double* const(&columns)[3]) {
                return Wide3{load(columns[0] + at), load(columns[1] + at), load(columns[2] + at)};
            };
            packet.rays[g] = {triple(batch.origin), triple(batch.dir), load(batch.surface + at)};
            packet.t[g] = load(batch.t + at);
            packet.surface[g] = all_lanes(std::int64_t{none});
            if (batch.any_hit) {
                const Mask met =
                    walker.meets_anything<composites>(packet.rays[g], ~Mask{}, packet.t[g]);
                packet.surface[g] = select(met, WideInt{}, packet.surface[g]);
            } else {
                const Walker::Found found =
                    walker.first_entry<composites>(packet.rays[g], packet.t[g]);
                packet.t[g] = found.t;
                packet.surface[g] = found.surface;
            }
        }
        unsigned active = 0;
        for (int g = 0; g < packet_groups; ++g)
            active |= bits_of(batch.any_hit ? packet.surface[g] < 0 : ~Mask{}) << (g * lanes);
        if (tables.bvh && active != 0) {
            if (batch.any_hit) {
                const unsigned blocked = spheres.find_blocked(packet, active);
                for (int g = 0; g < packet_groups; ++g)
                    packet.surface[g] = select(mask_of(blocked >> (g * lanes) & every_lane),
                                               WideInt{}, packet.surface[g]);
            } else {
                spheres.find_nearest(packet, active);
            }
        }
        for (std::size_t g = 0; g < packet_groups; ++g) {
            store(batch.t + i + g * lanes, packet.t[g]);
            store(batch.surface + i + g * lanes, packet.surface[g]);
        }
    }
}

inline void find_hits(const Tables& tables, const RayBatch& batch) {
    return tables.leaf_is_surface ? find_hits_with<false>(tables, batch)
                                  : find_hits_with<true>(tables, batch);
}

} // namespace
} // namespace fraja::kernel
