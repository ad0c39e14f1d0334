// Every limit and every interval of the broker, in one place.
#pragma once

#include "common/base/instant.hpp"

#include <cstddef>
#include <cstdint>

namespace fraja::broker {

/// As so many threads a broker that serves another one as a worker greets it, however many workers
/// it has: what it is sent at once is then an eighth of its power, and its speed is learnt there as
/// that of any worker.
inline constexpr std::uint32_t branch_threads = 8;

struct Limits {
    std::size_t workers_max = 20'000;
    std::size_t clients_max = 5'000;
    std::size_t jobs_max = 1'000; ///< not yet over
    /// Keys and workers of which it is known, as long as the broker runs, that they answer wrong
    /// pixels; what jobs know of them goes with the jobs.
    std::size_t liars_max = 10'000;
    std::size_t finished_jobs_max = 1'000; ///< kept for watchers; the oldest are forgotten first
    Duration keep = std::chrono::hours(7 * 24); ///< so long; then they are forgotten, too
    std::size_t tombstones_max = 10'000;        ///< ids of forgotten jobs that are not used again
    /// Of what is on its way to the store; beyond, no tiles are handed out.
    std::uint64_t unstored_bytes_max = std::uint64_t{256} << 20;
    std::size_t unstored_writes_max = 100'000; ///< likewise; beyond, people's wishes are refused
    std::uint64_t stored_bytes_max = std::uint64_t{8}
                                     << 30; ///< pixels, done and promised, of all jobs kept
    /// Of these, of the jobs of one client that are not over, so that one that asks for very much
    /// leaves room for others. A client is a connection here: one key is often many people's, or
    /// programs', and without keys nobody is known. Jobs whose client has left, as after
    /// --detach, and those from before a restart count in the sum of all alone.
    std::uint64_t client_bytes_max = std::uint64_t{6} << 30;
    std::uint64_t blob_bytes_max = std::uint64_t{4} << 30; ///< scenes, arrived and announced
    std::uint32_t attempts_max = 3;          ///< failures of one tile before its job fails
    std::uint64_t dealt_cells_max = 65'536;  ///< of a job of fixed tiles that is dealt out at once
    std::uint64_t probe_squares_max = 1'024; ///< in a probe of a picture
    /// Different topics that are subscribed to, of all watchers together: the stream does not tell
    /// who subscribes. Beyond, all are cut off. Each watcher has up to three, and is a client, too,
    /// if it is to see anything that it has missed, and so within clients_max.
    std::size_t topics_max = 20'000;
    std::uint32_t repair_tiles_max = 256; ///< in one answer
    std::uint64_t repair_bytes_max = std::uint64_t{4}
                                     << 20;  ///< in one answer, but for its first tile
    std::size_t farm_jobs_max = 200;         ///< in a FarmState
    std::size_t farm_workers_max = 1'000;    ///< in a FarmState
    std::size_t farm_tags_bytes_max = 200;   ///< of a worker in a FarmState: the first of its tags
    std::size_t farm_version_bytes_max = 64; ///< of a worker in a FarmState
    std::size_t farm_distrusted_max = 1;     ///< of a job in a FarmState: the first of them
    std::size_t farm_distrust_bytes_max = 100; ///< of a worker in a FarmState: of why
    std::size_t farm_reason_bytes_max = 500;   ///< of a job in a FarmState, which is one frame
    // Of refusals for want of a role, each of a key's deeds is logged once in a while, and no more
    // than so many then.
    Duration refusal_told_interval = std::chrono::minutes(10);
    std::size_t refusals_told_max = 1'000;

    // A worker that failed so many tiles within the window gets none for as long.
    std::uint32_t quarantine_failures = 3;
    Duration quarantine_window = std::chrono::minutes(10);
    /// A tile of which workers have drawn different pixels, where nobody else is left who could
    /// tell who is right: after so long those who have failed to draw it are asked again.
    Duration contest_interval = std::chrono::seconds(10);
    /// So long it is known of a process whose connection broke that it was drained, what it failed,
    /// and which tiles it had: it may come back.
    Duration absence_max = std::chrono::minutes(10);

    /// A tile should not take less (its way costs a twentieth of that), nor so little that the farm
    /// has more of them in a second.
    Duration tile_time_min = std::chrono::milliseconds(4);
    double tiles_per_s_max = 20'000;
    Duration tile_time_max = std::chrono::seconds(5); ///< nor more, where it can be cut
    /// Of a tile of more than one block of the picture.
    Duration joined_time_max = std::chrono::milliseconds(500);
    /// So long a tile is left, at most, to those who have its scene: others would be later.
    Duration held_back_max = std::chrono::seconds(1);
    /// That a worker has, as far as is known here: it keeps eight.
    std::size_t remembered_scenes_max = 8;
    std::size_t fetch_times_max = 1'000; ///< scenes of which it is known how long that takes
    /// While workers are idle: how often it is asked whether they could help others out.
    Duration overbook_interval = std::chrono::milliseconds(50);
    std::uint32_t overbooked_parts_max = 16; ///< of one tile

    // Several brokers.
    std::uint32_t peer_beats = 4;     ///< to each other, in a heartbeat
    double peer_patience_beats = 1.3; ///< heartbeats: who was not heard for so long is gone
    /// Heartbeats: so long it counts that somebody else has heard the leader. Workers hear it once
    /// in one, and say so once in one.
    double told_patience_beats = 3.25;
    std::uint32_t rumour_beats = 10; ///< heartbeats: so seldom a worker's word of a term counts
    /// So far ahead of the clock the counter of a term may be that a worker tells of: they begin
    /// with the time in microseconds, by clocks that may be wrong.
    Duration rumour_ahead_max = std::chrono::days(366);
    std::uint32_t workers_patience_beats = 5; ///< who has had no workers for so long has none
    /// So long a broker that begins to lead waits for workers to say what they have in hand.
    double gathering_beats = 0.5;
    Duration compare_interval = std::chrono::seconds(1); ///< of two that differ
    /// Tiles that are younger are on their way to the others.
    Duration copy_lag = std::chrono::seconds(1);
    /// A job is acknowledged without a copy when nobody who is here has kept one for so long.
    Duration copy_patience = std::chrono::seconds(2);
    /// A copy is given up that has got no tile, or no part of its scene, for so long that it lacks:
    /// whoever had them is gone.
    Duration partial_copy_patience = std::chrono::minutes(1);
    std::size_t copies_asked_max = 64; ///< jobs at once, of one broker

    Duration heartbeat = std::chrono::seconds(1);
    std::uint32_t liveness = 3; ///< beats a peer may miss
    Duration lease =
        std::chrono::seconds(60); ///< a tile that traces no ray for so long is given to another
    Duration scene_patience =
        std::chrono::seconds(60); ///< a job whose scene does not come on for so long fails
    Duration digest_interval = std::chrono::milliseconds(100);
    Duration digest_tail = std::chrono::seconds(5); ///< digests go on so long after a job is over
    Duration farm_interval = std::chrono::milliseconds(500);
};

/// A client follows the stream by a second one.
[[nodiscard]] constexpr std::size_t connections_of(std::size_t workers, std::size_t clients) {
    return workers + 2 * clients;
}
/// Of all peers.
[[nodiscard]] constexpr std::size_t connections_max(const Limits& limits) {
    return connections_of(limits.workers_max, limits.clients_max);
}

} // namespace fraja::broker
