// Pool: what the worker's shell asks of whoever draws the tiles.
#pragma once

#include "common/base/instant.hpp"
#include "worker/session.hpp"

#include <cstdint>
#include <vector>

namespace fraja::worker {

/// What a pool has done, as the event for the session that asked.
struct PoolResult {
    SessionIndex session{};
    Event event; ///< SceneCompiled, SceneFailed, TileFinished or TileBroken
};

/// Called from one thread. The actions of a session come in the order in which it took them.
class Pool {
public:
    Pool() = default;
    virtual ~Pool() = default;
    Pool(const Pool&) = delete;
    Pool& operator=(const Pool&) = delete;

    virtual void perform(SessionIndex session, CompileScene action) = 0;
    virtual void perform(SessionIndex session, const StartTile& action) = 0;
    virtual void perform(SessionIndex session, const StopTile& action) = 0;
    virtual void perform(SessionIndex session, const ForgetScene& action) = 0;

    [[nodiscard]] virtual std::vector<PoolResult> take_results() = 0;
    /// When results are due that no other thread tells of; it may be at once.
    [[nodiscard]] virtual Instant next_deadline() const = 0;
    /// No tile is drawn or waits to be.
    [[nodiscard]] virtual bool is_idle() const = 0;
    /// Of the tiles that are being drawn now.
    [[nodiscard]] virtual std::vector<TileProgress> progress(SessionIndex session) const = 0;
};

} // namespace fraja::worker
