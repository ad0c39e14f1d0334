// Timetable: when the threads of emulated workers are done with which tile.
#pragma once

#include "common/base/instant.hpp"
#include "worker/pool.hpp"

#include <cstddef>
#include <cstdint>
#include <deque>
#include <set>
#include <tuple>
#include <vector>

namespace fraja::worker {

/// Of each worker so many threads, of one speed, take its tiles in the order in which they come.
/// A tile that waits begins when the one before it ends, to the nanosecond, however late anybody
/// looks: so delays do not add up. `now` never goes back.
class Timetable {
public:
    /// Of each worker (from 0 on) rays per second and thread.
    Timetable(std::vector<double> speeds, std::uint32_t threads);

    void start(Instant now, SessionIndex worker, Ticket ticket, std::uint64_t rays);
    /// Frees the tile's thread at once. A tile that has ended, or never began, is none.
    void stop(Instant now, SessionIndex worker, Ticket ticket);

    struct Done {
        SessionIndex worker{};
        Ticket ticket{};
        Duration elapsed{};
        friend bool operator==(const Done&, const Done&) = default;
    };
    /// What has ended since it was asked last, in the order of the ends.
    [[nodiscard]] std::vector<Done> take_done(Instant now);
    /// When the next tile ends.
    [[nodiscard]] Instant next_deadline() const;
    /// Of the tiles that have a thread now: their share of rays by the time passed.
    [[nodiscard]] std::vector<TileProgress> progress(Instant now, SessionIndex worker) const;

private:
    struct Tile {
        Ticket ticket{};
        std::uint64_t rays = 0;
        Instant begin{}, end{}; // of those that have a thread
    };
    struct Worker {
        double speed = 0;
        std::vector<Tile> running; // at most a tile for each thread
        std::deque<Tile> waiting;
    };
    Worker& at(SessionIndex worker) { return workers_.at(static_cast<std::size_t>(worker)); }
    void advance(Instant now);
    void begin_next(Instant begin, SessionIndex worker);

    const std::uint32_t threads_;
    std::vector<Worker> workers_;
    std::set<std::tuple<Instant, SessionIndex, Ticket>> ends_;
    std::vector<Done> done_;
};

} // namespace fraja::worker
