// A job of four pixels in a row, each a tile, for tests of the live page.
#pragma once

#include "client/page/job_view.hpp"

#include <array>
#include <cstring>

namespace fraja::client {

inline bool admit_all(std::uint64_t) {
    return true;
}

inline protocol::JobState small_job() {
    protocol::JobState state;
    state.job = JobId{{4, 2}};
    state.number = 1;
    state.job_name = "small";
    state.phase = protocol::JobPhase::running;
    state.settings.size = {4, 1};
    state.settings.crop = {0, 0, 4, 1};
    state.cell_side = 1;
    state.cell_count = 4;
    return state;
}

inline protocol::TileDone small_tile(std::uint32_t x, float grey) {
    protocol::TileDone done;
    done.job = small_job().job;
    done.tile = TileIndex{x};
    done.rect = {x, 0, 1, 1};
    done.worker_name = "ada";
    done.elapsed = std::chrono::milliseconds(1);
    const std::array<float, 3> rgb = {grey, grey, grey};
    Bytes bytes(sizeof rgb);
    std::memcpy(bytes.data(), rgb.data(), bytes.size());
    done.blobs = {Blob(std::move(bytes))};
    return done;
}

} // namespace fraja::client
