// Party: who shares the farm with others as one: a film, which is many jobs, or a single picture.
#pragma once

#include "broker/events.hpp"
#include "common/base/assert.hpp"
#include "common/protocol/messages.hpp"

#include <cstddef>
#include <cstdint>
#include <map>

namespace fraja::broker {

/// Tiles at workers, of all its jobs together: each of these counts its own in here.
class Party {
public:
    /// `number`, of its first job, is its own as long as it is there. All its jobs have these
    /// wishes, but for the frame.
    Party(std::uint32_t number, protocol::Wishes wishes)
        : number_(number), wishes_(std::move(wishes)) {}

    [[nodiscard]] std::uint32_t number() const { return number_; }
    [[nodiscard]] const protocol::Wishes& wishes() const { return wishes_; }
    [[nodiscard]] bool is_film() const { return wishes_.film != FilmId{}; }
    [[nodiscard]] std::size_t in_flight_count() const { return in_flight_count_; }
    [[nodiscard]] const std::map<PeerId, std::size_t>& workers() const { return workers_; }

    void add(const PeerId& peer) {
        ++in_flight_count_;
        ++workers_[peer];
    }
    void remove(const PeerId& peer, std::size_t tiles = 1) {
        const auto worker = workers_.find(peer);
        FRAJA_ASSERT(worker != workers_.end() && worker->second >= tiles);
        in_flight_count_ -= tiles;
        worker->second -= tiles;
        if (worker->second == 0)
            workers_.erase(worker);
    }

private:
    std::uint32_t number_;
    protocol::Wishes wishes_;
    std::size_t in_flight_count_ = 0;
    std::map<PeerId, std::size_t> workers_;
};

} // namespace fraja::broker
