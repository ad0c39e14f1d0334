// Figures: the broker's core in numbers, for whoever watches over it.
#pragma once

#include "common/base/instant.hpp"
#include "common/protocol/messages.hpp"

#include <array>
#include <cstdint>
#include <string>

namespace fraja::broker {

/// What has happened so far, by kind. Nothing here ever becomes less.
struct Counters {
    // what went wrong
    std::uint64_t rubbish = 0;       ///< bytes that were no message
    std::uint64_t wrong_version = 0; ///< messages of another version
    std::uint64_t unexpected = 0;    ///< messages that had no place in their session
    std::uint64_t stale_answers = 0; ///< answers for tiles that nobody waits for
    std::uint64_t peers_refused = 0; ///< workers and clients whose hello was
    std::uint64_t not_allowed = 0;   ///< messages whose sender's key lacks the role for them
    std::uint64_t workers_lost = 0;
    std::uint64_t workers_quarantined = 0;
    std::uint64_t tiles_failed = 0; ///< failures that count against their tile
    std::uint64_t tiles_requeued = 0;
    std::uint64_t tiles_overbooked = 0;   ///< given out once more, as they took long
    std::uint64_t answers_unneeded = 0;   ///< somebody else was first
    std::uint64_t answers_distrusted = 0; ///< of workers whose pixels are wrong
    std::uint64_t workers_distrusted = 0;
    std::uint64_t tiles_unchecked = 0; ///< that were to be, but there was no second worker
    // what went well
    std::uint64_t tiles_checked = 0; ///< that two workers drew, and both the same
    std::uint64_t tiles_sent = 0;    ///< again and again, if need be
    std::uint64_t tiles_done = 0;
    std::uint64_t workers_welcomed = 0;
    std::uint64_t jobs_acknowledged = 0, jobs_done = 0, jobs_failed = 0, jobs_cancelled = 0;
    protocol::Rays rays;    ///< of the tiles that are done
    Duration render_time{}; ///< likewise, summed over render threads
    friend bool operator==(const Counters&, const Counters&) = default;
};

/// How it is now.
struct Figures {
    /// Jobs that are known, by phase: those that are over, too, as long as they are kept.
    std::array<std::uint64_t, protocol::ValueCount<protocol::JobPhase>::value> jobs{};
    std::uint64_t jobs_ready = 0; ///< that have something to give to whoever has room
    // Of jobs that are queued or running:
    std::uint64_t cells_left = 0; ///< not done
    /// What is left would take a thread so long; 0 as long as nothing is known of how fast these
    /// are.
    double work_left_s = 0;

    // Each worker is one of these.
    std::uint64_t workers_idle = 0, workers_busy = 0;
    std::uint64_t workers_draining = 0; ///< or drained: they get nothing more
    std::uint64_t workers_quarantined = 0, workers_distrusted = 0;
    std::uint64_t threads = 0; ///< of those that may be given something
    std::uint64_t credit = 0;  ///< tiles these may have in all
    std::uint64_t tiles_in_flight = 0;

    bool leads = false;     ///< it hands out the tiles
    std::uint64_t term = 0; ///< the newest one's counter
    // Brokers that stand for each other:
    std::uint64_t brokers_here = 0;        ///< this one included
    std::uint64_t brokers_gone = 0;        ///< known, and not heard
    std::uint64_t jobs_lacking_copies = 0; ///< not over, and not at every one of these

    std::uint64_t clients = 0;
    std::uint64_t jobs_watched = 0; ///< whose stream has a subscriber

    std::uint64_t scene_bytes = 0;    ///< in memory, arrived and announced
    std::uint64_t unstored_bytes = 0; ///< on their way to the store
    bool store_is_behind = false;     ///< so nothing is handed out
    std::string store_trouble;        ///< why nothing can be kept; empty: all is well

    Counters counters;

    [[nodiscard]] std::uint64_t jobs_not_over() const {
        std::uint64_t count = 0;
        for (std::size_t phase = 0; phase < jobs.size(); ++phase)
            count += protocol::is_over(static_cast<protocol::JobPhase>(phase)) ? 0 : jobs[phase];
        return count;
    }
    [[nodiscard]] std::uint64_t workers() const {
        return workers_idle + workers_busy + workers_draining + workers_quarantined +
               workers_distrusted;
    }
};

} // namespace fraja::broker
