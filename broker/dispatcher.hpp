// The broker's core: who is there, what is to be done, who gets it. No socket, clock, thread or
// global: time and messages come in through `step`, everything to be done comes out of it.
#pragma once

#include "broker/blob_store.hpp"
#include "broker/events.hpp"
#include "broker/job.hpp"
#include "broker/limits.hpp"
#include "common/base/ids.hpp"
#include "common/base/instant.hpp"
#include "common/protocol/messages.hpp"

#include <compare>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace fraja::broker {

/// What went wrong so far, by kind.
struct Counters {
    std::uint64_t rubbish = 0;       ///< bytes that were no message
    std::uint64_t wrong_version = 0; ///< messages of another version
    std::uint64_t unexpected = 0;    ///< messages that had no place in their session
    std::uint64_t stale_answers = 0; ///< answers for tiles that nobody waits for
    std::uint64_t workers_lost = 0;
    std::uint64_t tiles_requeued = 0;
    friend bool operator==(const Counters&, const Counters&) = default;
};

class Dispatcher {
public:
    struct Identity {
        BrokerId broker;
        std::uint64_t epoch = 0;
        std::string stream; ///< endpoint of the stream, told to every peer
    };

    Dispatcher(Identity identity, Limits limits);

    /// Takes in one event and appends what must now be done. Same history, same actions.
    void step(Instant now, const Event& event, std::vector<Action>& actions);

    /// When a Tick is due even if nothing arrives.
    [[nodiscard]] Instant next_deadline() const;

    [[nodiscard]] const Counters& counters() const { return counters_; }
    [[nodiscard]] std::size_t worker_count() const { return workers_.size(); }
    [[nodiscard]] std::size_t client_count() const { return clients_.size(); }
    [[nodiscard]] std::size_t job_count() const { return jobs_.size(); }
    /// What a person wants to know, one line each: for USR1.
    [[nodiscard]] std::vector<std::string> describe(Instant now) const;

private:
    struct GrantKey {
        JobId job;
        TileIndex tile{};
        AttemptNumber attempt{};
        friend auto operator<=>(const GrantKey&, const GrantKey&) = default;
    };
    /// A tile at a worker. It takes up credit until the worker answers, also when it is cancelled.
    struct Grant {
        Instant granted_at, progress_at;
        std::uint64_t number = 0; ///< counts the session's tiles, from 0
        std::uint64_t rays = 0;
        bool cancelled = false;
    };
    struct WorkerSession {
        protocol::WorkerHello hello;
        std::uint32_t credit = 0;
        Instant heard_at;
        std::map<GrantKey, Grant> grants;
        std::optional<std::uint64_t> load; ///< its key in free_workers_, while it is there
        std::uint64_t tiles_sent = 0, tiles_done = 0;
        protocol::Rays rays;
    };
    struct ClientSession {
        std::string name;
        Instant heard_at;
    };
    using Workers = std::map<PeerId, WorkerSession>;

    // sessions.cpp: who is there
    void on(const PeerSaid& event);
    void on(const PeerSpokeRubbish& event);
    void on(const PeerUnreachable& event);
    void welcome_worker(const PeerId& peer, const protocol::WorkerHello& hello);
    void welcome_client(const PeerId& peer, const protocol::ClientHello& hello);
    void from_worker(const PeerId& peer, WorkerSession& worker, const protocol::Message& message);
    void from_client(const PeerId& peer, const protocol::Message& message);
    void beat(const PeerId& peer, WorkerSession& worker, const protocol::WorkerBeat& beat);
    enum class Departure { said_goodbye, lost, replaced };
    void end_worker(Workers::iterator worker, Departure departure, const std::string& why);
    void end_client(const PeerId& peer, Departure departure);
    void drop_silent_peers();
    void refuse(const PeerId& peer, protocol::RefusalCode code, const std::string& reason,
                JobId job = {});

    // jobs.cpp: what is to be done
    void submit(const PeerId& peer, const protocol::SubmitJob& submission);
    [[nodiscard]] std::optional<protocol::Refused>
    objection(const protocol::SubmitJob& submission) const;
    void ask_for_scene(Job& job);
    void give_up_scene(Job& job, const std::string& why);
    void ask_others_for_scene(const ContentHash& scene);
    void give_up_scenes_that_do_not_come();
    void take_chunk(const PeerId& peer, const protocol::Chunk& chunk);
    void give_chunk(const PeerId& peer, const protocol::NeedChunk& need);
    void acknowledge(Job& job);
    void find_job(const PeerId& peer, const protocol::FindJob& find);
    void cancel_job(const PeerId& peer, const protocol::CancelJob& cancel);
    void end_job(Job& job, protocol::JobPhase phase, const std::string& reason);
    void forget(JobId id);
    [[nodiscard]] Job* job_of(const JobId& id);

    // tiles.cpp: who gets it
    void dispatch();
    [[nodiscard]] Job* job_for_next_tile();
    bool grant_tile(const PeerId& peer, WorkerSession& worker, Job& job);
    [[nodiscard]] std::optional<Grant> end_grant(const PeerId& peer, WorkerSession& worker,
                                                 const GrantKey& key);
    void tile_rendered(const PeerId& peer, WorkerSession& worker,
                       const protocol::TileRendered& answer);
    void tile_failed(const PeerId& peer, WorkerSession& worker, const protocol::TileFailed& answer);
    void accept(Job& job, const PeerId& peer, WorkerSession& worker,
                const protocol::TileRendered& answer, Duration elapsed_max);
    void count_failure(Job& job, TileIndex tile, const WorkerSession& worker,
                       const std::string& why);
    void take_back(const PeerId& peer, const GrantKey& key, bool counts,
                   const WorkerSession& worker, const std::string& why);
    void cancel_grant(const PeerId& peer, const GrantKey& key);
    void take_back_stuck_tiles();
    void end_jobs_whose_time_is_up();
    void update_load(const PeerId& peer, WorkerSession& worker);

    // stream.cpp: who hears of it
    void on(const TopicSubscribed& event);
    void on(const TopicUnsubscribed& event);
    void on(const Tick&) {}
    void publish_digests();
    void publish_farm_state();
    void publish_state(const Job& job);
    [[nodiscard]] protocol::JobState brief_state(const Job& job) const;
    void repair(const PeerId& peer, const protocol::Repair& repair);
    [[nodiscard]] bool wants_digest(const Job& job) const;

    void send(const PeerId& peer, protocol::Message message);
    void log(LogLevel level, std::string text);

    Identity identity_;
    Limits limits_;
    Counters counters_;

    Workers workers_;
    std::map<WorkerId, PeerId> peer_of_worker_;
    std::map<PeerId, ClientSession> clients_;
    std::set<std::pair<std::uint64_t, PeerId>>
        free_workers_;                    ///< with credit left, the least loaded first
    std::size_t workers_with_credit_ = 0; ///< whose credit is not 0

    std::map<JobId, Job> jobs_;
    std::set<JobId> ready_;                         ///< jobs with pending tiles
    std::set<std::pair<Instant, JobId>> deadlines_; ///< of jobs with a time limit, not over
    std::map<std::uint32_t, JobId> job_by_number_;
    std::uint32_t last_number_ = 0;
    BlobStore blobs_;

    std::set<JobId> subscribed_jobs_;
    bool farm_subscribed_ = false;

    Instant now_;
    Instant next_sweep_{}, next_digest_{}, next_farm_state_{};
    std::vector<Action>* actions_ = nullptr; ///< during a step
};

} // namespace fraja::broker
