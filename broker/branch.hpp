// Branch: what makes a broker a worker of another one. It stands where a worker has its render
// threads: the tiles that its sessions are sent become orders for the dispatcher, which are split
// among this broker's own workers, and what they draw is put together again.
#pragma once

#include "broker/events.hpp"
#include "broker/limits.hpp"
#include "common/base/rng.hpp"
#include "common/protocol/pixels.hpp"
#include "worker/pool.hpp"

#include <cstdint>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <vector>

namespace fraja::broker {

class Branch final : public worker::Pool {
public:
    /// `progress`: what is known of the orders' rays, asked when a beat is due. `rng` makes the
    /// orders' ids, so no two branches that ever meet may have one seed.
    Branch(std::function<std::vector<OrderProgress>()> progress, Rng rng)
        : progress_(std::move(progress)), rng_(rng) {}

    // What sessions want.
    void perform(worker::SessionIndex session, worker::CompileScene action) override;
    void perform(worker::SessionIndex session, const worker::StartTile& action) override;
    void perform(worker::SessionIndex session, const worker::StopTile& action) override;
    void perform(worker::SessionIndex session, const worker::ForgetScene& action) override;
    [[nodiscard]] std::vector<worker::PoolResult> take_results() override;
    [[nodiscard]] Instant next_deadline() const override { return Instant::never(); }
    [[nodiscard]] bool is_idle() const override { return orders_.empty(); }
    [[nodiscard]] std::vector<worker::TileProgress>
    progress(worker::SessionIndex session) const override;

    /// For the dispatcher.
    [[nodiscard]] std::vector<Event> take_events();
    /// What it answered. `threads`: of all workers here.
    void take(const OrderFilled& filled, std::uint64_t threads);
    void take(const OrderFailed& failed);

private:
    struct Scene {
        Blob text;
        std::set<worker::SessionIndex> wanted_by;
    };
    struct Given {
        worker::SessionIndex session{};
        worker::Ticket ticket{};
        PixelRect rect;
        std::uint64_t pixel_bytes = 0;
    };
    [[nodiscard]] JobId new_id();

    std::function<std::vector<OrderProgress>()> progress_;
    Rng rng_;
    std::map<ContentHash, Scene> scenes_;
    std::map<JobId, Given> orders_;
    std::map<worker::Ticket, JobId> order_of_;
    std::vector<Event> events_;
    std::vector<worker::PoolResult> results_;
};

} // namespace fraja::broker
