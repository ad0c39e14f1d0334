// The broker's core: who is there, what is to be done, who gets it. No socket, clock, thread or
// global: time and messages come in through `step`, everything to be done comes out of it.
#pragma once

#include "broker/blob_store.hpp"
#include "broker/events.hpp"
#include "broker/fetch_times.hpp"
#include "broker/figures.hpp"
#include "broker/job.hpp"
#include "broker/limits.hpp"
#include "broker/membership.hpp"
#include "broker/ready_jobs.hpp"
#include "broker/speed.hpp"
#include "common/base/ids.hpp"
#include "common/base/instant.hpp"
#include "common/base/once.hpp"
#include "common/protocol/messages.hpp"

#include <compare>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace fraja::broker {

/// Clients of before do not know of distrust, and would keep what was drawn wrong.
inline constexpr protocol::Version checked_jobs_since = 12;
inline constexpr std::string_view cannot_follow =
    "the tiles of this job are checked (--verify): a newer program can follow it";

class Dispatcher {
public:
    struct Identity {
        BrokerId broker;
        std::uint64_t epoch = 0; ///< the least counter of its terms
        std::string stream;      ///< endpoint of the stream, told to every peer
        bool keeps = false;      ///< there is a store: what is persisted is Stored
        Instant started_at{};
        Duration unix_offset{};           ///< since 1970, at Instant{}
        std::string endpoint{};           ///< where others reach it; empty: that is not known
        std::vector<std::string> peers{}; ///< endpoints of brokers that stand for this one
        std::uint64_t check_key = 0; ///< decides which tiles are checked; workers do not know it
        bool is_branch = false;      ///< it serves another broker: then no others stand for it
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
    /// Of workers that have room for tiles, if not at the moment.
    [[nodiscard]] std::uint64_t thread_count() const { return threads_with_credit_; }
    [[nodiscard]] std::vector<OrderProgress> order_progress() const;
    /// Looks at every job and worker.
    [[nodiscard]] Figures figures() const;
    /// The wall clock, which may be set while the broker runs.
    void set_unix_offset(Duration offset) { identity_.unix_offset = offset; }
    [[nodiscard]] const Membership& membership() const { return membership_; }
    /// Whether it hands out tiles: it leads, and knows what the workers have in hand.
    [[nodiscard]] bool deals_out() const { return membership_.leads() && !gathers_until_; }
    /// Those that nobody has been told of, and nothing is as large as: lease, attempts_max,
    /// quarantine and keep. The others stay.
    void change_limits(const Limits& limits);
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
        OpenTileId id{}; ///< none: a check, or a probe of the job's picture
        CheckId check{};
        std::uint32_t probe_side = 0; ///< then
        Tile tile{};
        double work = 0; ///< that it is thought to be
        Instant granted_at{}, progress_at{};
        std::optional<Instant> started_at{}; ///< as far as can be told from here
        std::uint64_t number = 0;            ///< counts the session's tiles, from 0
        std::uint64_t rays = 0;
        bool cancelled = false;
        bool overtaken = false;     ///< one that came later has been traced: so it has begun
        bool fetches_scene = false; ///< it is the worker's first one of that scene
        bool adopted = false;       ///< another broker gave it

        [[nodiscard]] bool has_begun() const { return rays > 0 || overtaken; }
    };
    /// A tile of a worker, by its own word.
    struct InHand {
        protocol::TileInFlight tile;
        Instant progress_at;
        Instant seen_at; ///< first
    };
    struct WorkerSession {
        protocol::WorkerHello hello;
        std::uint32_t credit = 0;
        Instant heard_at;
        std::map<GrantKey, Grant> grants;
        std::optional<std::uint64_t> load; ///< its key in free_workers_, while it is there
        std::uint64_t tiles_sent = 0, tiles_done = 0;
        /// When it last traced a ray, ended a tile by itself, or fetched some of a scene.
        Instant moved_at{};
        protocol::Rays rays;
        Speed speed;                  ///< of one thread
        double capacity = 0;          ///< as it counts in capacity_
        bool drained = false;         ///< on somebody's word
        std::deque<Instant> failures; ///< within the window
        std::optional<Instant> quarantined_until;
        std::string distrusted; ///< why it gets nothing: its pixels are wrong; empty: they are not
        std::map<FilmId, JobId> frames;     ///< of each film the one it was last given something of
        std::vector<ContentHash> scenes;    ///< that it was given something of, the last one last
        std::map<GrantKey, InHand> in_hand; ///< as it said last, whoever gave them
        std::map<GrantKey, InHand> had_in_hand; ///< in the session before, until it has told
        std::size_t of_others = 0; ///< of these: no grants of ours, and they fill its credit
        /// What others have given it, since it was greeted or this broker leads.
        bool has_told = false;
        std::optional<Instant> tells_by; ///< it gets nothing before that, or before it has told
        BrokerId heard_leader;           ///< as its beats say
        Instant leader_heard_at{};       ///< by it
        Holder holder;                   ///< of the key it came with
        WorkerId drawer;                 ///< drawer_of
        std::string voter;               ///< voter_of

        /// Tiles that it has to draw, or will have when they have come.
        [[nodiscard]] std::size_t held() const { return grants.size() + of_others; }
        /// Tiles it may be given in all.
        [[nodiscard]] std::uint32_t room() const {
            return drained || quarantined_until || !distrusted.empty() || tells_by ? 0 : credit;
        }
    };
    struct ClientSession {
        std::string name;
        Instant heard_at;
        Holder holder;
    };
    using Workers = std::map<PeerId, WorkerSession>;
    /// A job as well, until it is over. Its scene is kept as long as a worker may ask for it.
    struct OpenOrder {
        ContentHash scene;
        PixelRect crop;               ///< of the picture; the job's is what was ordered
        std::uint32_t probe_side = 0; ///< of a probe's squares
        std::uint32_t failures = 0;   ///< of a probe
        std::uint32_t grants = 0;     ///< that are not answered
        bool over = false;
    };
    using Orders = std::map<JobId, OpenOrder>;

    // peers.cpp: the other brokers
    /// By which a message came, and its answer goes back.
    struct Route {
        bool is_dialled = false;
        std::string name; ///< an endpoint, or a PeerId
    };
    struct Line { ///< that was dialled
        bool is_configured = false;
        std::optional<BrokerId> broker;  ///< who is there, as far as is known
        std::optional<BrokerId> last;    ///< who has said hello there last
        std::optional<BrokerId> told_of; ///< who should be, as others told last
        Instant hello_at{};              ///< the last one
        Instant told_at{};               ///< when another broker last told of it
        Instant dialled_at{};
        bool was_answered = false; ///< by any broker
        bool is_missed = false;    ///< nobody ever has for long, and that was said
    };
    struct AskedRepair {
        Instant at{};
        std::uint64_t cells = 0; ///< a hash of what was here
    };
    struct Colleague {
        std::optional<PeerId> peer;           ///< by which it has come here
        bool was_here = false;                ///< and that was said
        bool is_replaced = false;             ///< where it was found another one has answered
        bool is_compared = false;             ///< it had nothing that was not here, once
        std::optional<std::uint64_t> same_as; ///< digest of what it has and is here as well
        Instant compare_at{};                 ///< not before
        std::map<JobId, AskedRepair> repairs; ///< and not answered
        std::set<JobId> repaired;             ///< answered in full
    };
    [[nodiscard]] bool is_alone() const {
        return identity_.peers.empty() && lines_.empty() && colleagues_.empty();
    }
    [[nodiscard]] protocol::Term term() const { return membership_.term(); }
    [[nodiscard]] std::string described_revisions(const Job& job) const;
    void on(const BrokerSaid& event);
    [[nodiscard]] bool make_room_for(const BrokerId& broker);
    void meet_broker(const PeerId& peer, protocol::Version spoken,
                     const protocol::BrokerHello& hello);
    void note_replaced(const BrokerId& broker);
    [[nodiscard]] std::uint64_t rumour_counter_max() const;
    void hear_workers_of_leader();
    void note_no_company(const std::string& endpoint, const std::string& why);
    void dial(const std::string& endpoint, bool is_configured);
    void consider_dialling(const protocol::Member& member);
    /// To somebody who is not known by another connection either.
    [[nodiscard]] bool is_to_nobody_known(const Line& line) const;
    [[nodiscard]] protocol::BrokerHello own_hello() const;
    [[nodiscard]] protocol::BrokerBeat own_beat() const;
    void say_hello(const std::string& endpoint, Line& line);
    void answer(const Route& route, protocol::Message message);
    void tell(const BrokerId& broker, protocol::Message message);
    void tell_all(const protocol::Message& message);
    [[nodiscard]] std::optional<Route> route_to(const BrokerId& broker) const;
    void from_broker(const BrokerId& broker, const Route& route, const protocol::Message& message);
    void keep_company();
    void note_who_is_here();
    void note_who_leads();
    void note_who_never_was();
    void forget_brokers_that_are_gone();
    void forget_broker(const BrokerId& id);
    void forget_predecessors(const protocol::BrokerHello& hello);
    [[nodiscard]] std::vector<protocol::Member> members() const;
    [[nodiscard]] std::string endpoint_of(const BrokerId& broker) const;
    [[nodiscard]] std::string named(const BrokerId& broker) const;
    [[nodiscard]] std::vector<protocol::PeerState> peer_states() const;
    void tell_of_brokers();

    // replication.cpp: what they have that is not here, and the reverse
    [[nodiscard]] protocol::JobRecord record_of(const Job& job) const;
    [[nodiscard]] protocol::JobDigests job_digests() const;
    [[nodiscard]] std::uint64_t digest() const;
    void note_change(Job& job);
    void tell_changes();
    void compare(const BrokerId& broker, const protocol::JobDigests& theirs);
    void ask_for_cells(const BrokerId& broker, const Job& job);
    void take_record(const BrokerId& broker, const protocol::JobRecord& record);
    void adopt_job(const BrokerId& broker, const protocol::JobRecord& record, const PeerId& client);
    void settle(Job& job);
    void follow(Job& job, const protocol::JobRecord& record);
    void give_number(Job& job, std::uint32_t number);
    void settle_numbers();
    void note_copy(const BrokerId& broker, const JobId& job);
    void note_copy(const BrokerId& broker, Job& job);
    void note_copies_of_all(const BrokerId& broker);
    void forget_copies(const BrokerId& broker);
    [[nodiscard]] std::uint32_t copies_wanted() const;
    [[nodiscard]] bool needs_copy(const Job& job) const;
    void acknowledge_if_safe(Job& job);
    void take_tile(const BrokerId& broker, const protocol::TileDone& tile);
    void repair_done(const BrokerId& broker, const protocol::RepairDone& done);
    void fetch_scene(const ContentHash& scene, const BrokerId& from);
    void fetch_scenes_anew();
    void take_scene_chunk(const BrokerId& broker, const protocol::Chunk& chunk);
    /// While one is there, what another broker has said is done: it is not said again.
    class Following {
    public:
        explicit Following(bool& follows) : follows_(follows) { follows_ = true; }
        ~Following() { follows_ = false; }
        Following(const Following&) = delete;
        Following& operator=(const Following&) = delete;

    private:
        bool& follows_;
    };

    // takeover.cpp: who leads
    [[nodiscard]] Duration gathering_time() const;
    void look_who_leads();
    void begin_to_lead();
    void end_gathering();
    void stop_leading();
    void note_in_hand(const PeerId& peer, WorkerSession& worker, const protocol::WorkerBeat& beat);
    [[nodiscard]] static const InHand* last_of(const WorkerSession& worker, const GrantKey& key);
    void adopt_in_hand(const PeerId& peer, WorkerSession& worker);
    void count_those_of_others(const PeerId& peer, WorkerSession& worker);
    void await_telling(const PeerId& peer, WorkerSession& worker);
    void wait_no_longer_for_silent_workers();
    void take_witnessed(WorkerSession& worker, const protocol::TileRendered& answer,
                        Duration longest);

    // sessions.cpp: who is there
    void on(const PeerSaid& event);
    void on(const PeerSpokeRubbish& event);
    void refuse_version(const PeerSpokeRubbish& event);
    void note_version(const PeerId& peer);
    void on(const PeerUnreachable& event);
    [[nodiscard]] protocol::Welcome welcome(std::uint64_t incarnation) const;
    void welcome_worker(const PeerId& peer, const protocol::WorkerHello& hello,
                        const Holder& holder);
    void welcome_client(const PeerId& peer, const protocol::ClientHello& hello,
                        const Holder& holder);
    void from_worker(const PeerId& peer, WorkerSession& worker, const protocol::Message& message);
    void from_client(const PeerId& peer, const protocol::Message& message);
    void beat(const PeerId& peer, WorkerSession& worker, const protocol::WorkerBeat& beat);
    /// Tiles of which it was a failure that their worker was lost.
    using Blames = std::vector<std::pair<JobId, OpenTileId>>;
    /// A worker that may come back.
    struct Absent {
        Instant left_at;
        WorkerSession session; ///< as it ended
        Blames blamed;
    };
    enum class Departure { said_goodbye, lost, replaced, dismissed };
    void end_worker(Workers::iterator worker, Departure departure, const std::string& why);
    void remember(WorkerSession session, Blames blamed);
    void recall(WorkerSession& worker);
    void forget_absent_workers();
    void end_client(const PeerId& peer, Departure departure);
    void note_own_absence(Duration since_last_step);
    void drop_silent_peers();
    void refuse(const PeerId& peer, protocol::RefusalCode code, const std::string& reason,
                JobId job = {});
    void turn_away(const PeerId& peer, protocol::RefusalCode code, const std::string& reason);

    // permission.cpp: who may say what
    [[nodiscard]] bool may_say(const PeerSaid& event);
    /// Of the workers that are here.
    [[nodiscard]] bool has_keys() const {
        return !workers_.empty() && workers_.begin()->second.holder;
    }
    void refuse_role(const PeerId& peer, const protocol::KeyHolder& holder, protocol::Roles needed,
                     const std::string& deed);
    void on(const RolesChanged& event);

    // jobs.cpp: what is to be done
    void submit(const PeerId& peer, const protocol::SubmitJob& submission);
    [[nodiscard]] std::optional<protocol::Refused>
    objection(const protocol::SubmitJob& submission) const;
    [[nodiscard]] std::optional<std::string>
    objection_to_film(const protocol::Wishes& wishes) const;
    [[nodiscard]] std::optional<std::string> objection_to_one_more() const;
    [[nodiscard]] std::optional<std::string> objection_to_share(const Job& wanted) const;
    [[nodiscard]] Result<std::vector<JobId>> room_for(const Job& wanted) const;
    [[nodiscard]] std::optional<std::vector<JobId>>
    oldest_to_free(const Job& wanted, std::uint64_t picture_bytes, std::uint64_t scene_bytes) const;
    void make_room(const std::vector<JobId>& going, const protocol::SubmitJob& coming);
    [[nodiscard]] std::shared_ptr<Party> party_of(const Job& job);
    [[nodiscard]] Job* newest_like(const PeerId& peer, const protocol::SubmitJob& submission);
    void ask_for_scene(Job& job);
    void fail_without_scene(Job& job, const std::string& why);
    void give_up_scene(Job& job, const std::string& why);
    void ask_others_for_scene(const ContentHash& scene);
    void give_up_scenes_that_do_not_come();
    void give_up_tiles_that_do_not_come();
    void take_chunk(const PeerId& peer, const protocol::Chunk& chunk);
    void give_chunk(const PeerId& peer, WorkerSession& worker, const protocol::NeedChunk& need);
    void begin_jobs_of(const ContentHash& scene);
    void bring_scene(const ContentHash& scene, const Blob& bytes);
    void want_probe(Job& job);
    void acknowledge(Job& job);
    void find_job(const PeerId& peer, const protocol::FindJob& find);
    void end_job(Job& job, protocol::JobPhase phase, const std::string& reason,
                 protocol::FailureCode fault = protocol::FailureCode::machine);
    void set_deadline(const Job& job);
    void clear_deadline(const Job& job);
    void withdraw(Job& job, protocol::JobPhase phase);
    void forget(JobId id);
    void discard(JobId id);
    [[nodiscard]] Job* job_of(const JobId& id);

    // control.cpp: what people want of jobs and workers, and what we want of workers that fail
    void control_job(const PeerId& peer, const protocol::ControlJob& control);
    void set_priority(Job& job, std::int32_t priority);
    [[nodiscard]] bool ask_others_to_retry(Job& job, const PeerId& peer);
    void log_deed(const Job& job, protocol::JobDeed deed);
    [[nodiscard]] std::optional<std::string> pause(Job& job);
    [[nodiscard]] std::optional<std::string> resume(Job& job);
    [[nodiscard]] std::optional<protocol::Refused> retry(Job& job);
    void control_worker(const PeerId& peer, const protocol::ControlWorker& control);
    [[nodiscard]] bool is_one(const PeerId& peer, std::size_t found, const std::string& what);
    void undrain(WorkerSession& worker);
    void undrain_absent(const PeerId& peer, const std::string& what);
    void count_machine_failure(const PeerId& peer, WorkerSession& worker);
    void give_no_more(const PeerId& peer, WorkerSession& worker, const std::string& why);
    void end_quarantines();

    // dispatch.cpp: who gets it
    void dispatch();
    void offer_to_changed_workers();
    void give_out();
    [[nodiscard]] bool give_one_of(const ReadyJobs::Group& group);
    [[nodiscard]] std::optional<PeerId> fastest_idle_worker(const Party& party) const;
    [[nodiscard]] static std::vector<JobId> frames_at_hand(const WorkerSession& worker,
                                                           const Party& party);
    [[nodiscard]] bool suits(const WorkerSession& worker, const PeerId& peer,
                             const Party& party) const;
    [[nodiscard]] bool lacks_tagged_worker(const Job& job) const;
    /// To jobs of a higher priority, and has nothing in flight.
    [[nodiscard]] bool gives_way(const Job& job) const;
    [[nodiscard]] static bool has_tags(const WorkerSession& worker, const protocol::Wishes& wishes);
    [[nodiscard]] bool has_others(const Job& job, std::span<const WorkerId> failed_on) const;
    [[nodiscard]] bool is_waiting_to_be_dealt_out(Job& job);
    bool grant(const PeerId& peer, WorkerSession& worker, Job& job);
    [[nodiscard]] std::optional<std::uint32_t> probe_side(const Job& job) const;
    bool grant_probe(const PeerId& peer, WorkerSession& worker, Job& job);
    bool grant_tile(const PeerId& peer, WorkerSession& worker, Job& job);
    void send_grant(const PeerId& peer, WorkerSession& worker, Job& job, Grant grant,
                    AttemptNumber attempt);
    [[nodiscard]] double work_wanted(const WorkerSession& worker, const Job& job) const;
    [[nodiscard]] double joined_work_max(const WorkerSession& worker) const;
    [[nodiscard]] std::optional<double> scout_work(const WorkerSession& worker,
                                                   const Job& job) const;
    [[nodiscard]] double tile_time_min_s() const;
    [[nodiscard]] double speed_of(const WorkerSession& worker) const;
    void look_ready(const Job& job);
    void update_load(const PeerId& peer, WorkerSession& worker);
    void change_room(const PeerId& peer, WorkerSession& worker, const auto& deed);
    void release_shares(const WorkerId& worker);
    void set_credit(const PeerId& peer, WorkerSession& worker, std::uint32_t credit);
    void set_tells_by(const PeerId& peer, WorkerSession& worker, std::optional<Instant> tells_by);
    void count_capacity(WorkerSession& worker);
    void add_up_capacity();

    // newcomers.cpp: whether more workers would help
    [[nodiscard]] bool newcomers_help(const Job& job) const;
    [[nodiscard]] double capacity_at(const Job& job) const;
    [[nodiscard]] Duration head_start(const Job& job) const;
    void hold_back(Job& job);
    [[nodiscard]] bool is_held_back(const Job& job) const;
    void release_held_back();
    [[nodiscard]] static bool has_scene(const WorkerSession& worker, const ContentHash& scene);
    [[nodiscard]] bool note_scene(WorkerSession& worker, const ContentHash& scene) const;
    static bool forget_scene(WorkerSession& worker, const ContentHash& scene);
    void learn_fetch_time(const ContentHash& scene, const Grant& grant, Duration elapsed);

    // overbooking.cpp: and who helps out when nothing is left to be given
    struct Late {
        Duration remaining{};
        JobId job;
        OpenTileId id{};
        double work = 0;
        PeerId peer;
    };
    struct Idle {
        PeerId peer;
        const WorkerSession* worker = nullptr;
        double speed = 0;
        std::size_t threads = 0; ///< that do nothing
    };
    struct Help {
        double speed = 0;
        std::size_t threads = 0;
    };
    void help_out();
    [[nodiscard]] std::vector<Idle> idle_workers() const;
    [[nodiscard]] Help help_for(const Late& late, const Job& job, const std::vector<Idle>& idle,
                                double bearable_s) const;
    [[nodiscard]] std::vector<Late> tiles_by_end() const;
    void append_ends(const PeerId& peer, const WorkerSession& worker,
                     std::vector<Late>& late) const;
    [[nodiscard]] bool somebody_is_idle() const;
    [[nodiscard]] bool somebody_has_tiles() const;

    // tiles.cpp: and what becomes of it
    [[nodiscard]] TilesBegun begun(const Job& job) const;
    void count_begun(TilesBegun& all, const Job& job, const Tile& tile, double work,
                     double speed) const;
    void look_what_is_drawn_elsewhere();
    [[nodiscard]] std::optional<Grant> end_grant(const PeerId& peer, WorkerSession& worker,
                                                 const GrantKey& key);
    void tile_rendered(const PeerId& peer, WorkerSession& worker,
                       const protocol::TileRendered& answer);
    void tile_failed(const PeerId& peer, WorkerSession& worker, const protocol::TileFailed& answer);
    [[nodiscard]] bool is_fault_of_scene(Job& job, const WorkerSession& worker) const;
    void learn_speed(WorkerSession& worker, double rays, Duration elapsed);
    struct Rendered {
        Duration elapsed{};
        double work = 0;
    };
    Rendered count_rendered(Job& job, WorkerSession& worker, Duration longest,
                            const protocol::TileRendered& answer);
    void accept(Job& job, WorkerSession& worker, const Grant& grant,
                const protocol::TileRendered& answer);
    /// Whether somebody who is believed has given the worker the tile: as far as is known here.
    enum class Giver : std::uint8_t { known, unknown };
    void take_result(Job& job, OpenTileId id, const Tile& tile, double work,
                     std::shared_ptr<const protocol::TileDone> result, Giver giver);
    void take_probe(Job& job, const protocol::TileRendered& answer, std::uint32_t side);
    void take_back_probe(Job& job, bool counts, const std::string& why);
    bool count_failure(Job& job, const Grant& grant, const WorkerSession& worker,
                       const std::string& why);
    bool take_back(const GrantKey& key, const Grant& grant, bool counts,
                   const WorkerSession& worker, const std::string& why);
    void cancel_grant(const PeerId& peer, const GrantKey& key);
    void cancel_unwanted(const Job& job, const std::vector<Job::Unwanted>& unwanted);
    void note_overtaken(WorkerSession& worker, std::uint64_t number);
    void take_back_stuck_tiles();
    [[nodiscard]] bool is_stuck(const WorkerSession& worker, bool has_begun,
                                Instant progress_at) const;
    void stop_stuck_tiles_of_others(const PeerId& peer, const WorkerSession& worker);
    void end_jobs_whose_time_is_up();

    // trust.cpp: tiles that are drawn twice, and workers whose pixels are wrong
    [[nodiscard]] bool is_to_be_checked(const Job& job, const Tile& tile, Giver giver) const;
    void want_check(Job& job, const Tile& tile, const protocol::TileDone& result, Giver giver);
    [[nodiscard]] Checks::HasOthers others_for(const Job& job) const;
    bool grant_check(const PeerId& peer, WorkerSession& worker, Job& job);
    void check_rendered(Job& job, WorkerSession& worker, const Grant& grant, AttemptNumber attempt,
                        const protocol::TileRendered& answer);
    void end_if_done(Job& job);
    void end_jobs_that_are_through();
    [[nodiscard]] std::optional<std::string> contest(const Job& job) const;
    void distrust(const std::vector<protocol::Distrusted>& liars, const JobId& found_in);
    void void_all_tiles(const protocol::Distrusted& who, const JobId& found_in);
    void void_tiles(Job& job, const protocol::Distrusted& who);
    void keep_voided(const Job& job, const protocol::Distrusted& who,
                     const std::vector<Tile>& tiles);
    bool take_distrusted(const JobId& id, const std::vector<protocol::Distrusted>& theirs);
    void heed_new_term();
    [[nodiscard]] bool leads_in(std::uint64_t epoch, const BrokerId& broker) const;
    [[nodiscard]] bool may_take_tiles(const Job& job, const BrokerId& from,
                                      std::uint64_t epoch) const;
    [[nodiscard]] bool is_checked_as_told(const Job& job) const;
    [[nodiscard]] bool ends_as_told(const Job& job) const;
    [[nodiscard]] bool can_do_without_tiles(const Job& job) const;
    void trust_as_told(Job& job);
    void void_again();
    void note_done_at_leader(Job& job);
    void tell_doubt(const Job& job, const protocol::Distrusted& who);
    void give_no_more(const protocol::Distrusted& who);
    void pardon(const WorkerId& drawer);
    void recall_distrust(WorkerSession& worker) const;

    // keeping.cpp: what is kept
    void on(const Restored& event);
    void on(const Stored& event);
    void on(const StoreFails& event);
    void on(const StoreWorks& event);
    void on(const SceneLoaded& event);
    void restore(const StoredJob& stored, const Restored& event);
    struct Unstored {
        std::uint64_t sequence = 0, bytes = 0;
        JobId job;
        std::optional<std::size_t> result{}; ///< its pixels are then let go
        bool acknowledges = false;
    };
    void persist(Write write, Unstored what);
    void keep_job(Job& job);
    void keep_phase(Job& job);
    void keep_newest_result(const Job& job);
    [[nodiscard]] bool store_is_behind() const {
        return !store_trouble_.empty() || unstored_bytes_ > limits_.unstored_bytes_max;
    }
    void forget_what_is_old();
    void bury(const JobId& job);
    [[nodiscard]] protocol::JobState state_of(const Job& job) const;

    // orders.cpp: what another broker wants of this one
    void on(const Ordered& event);
    void on(const OrderWithdrawn& event);
    [[nodiscard]] bool is_order(const Job& job) const { return orders_.contains(job.id()); }
    void fill_probe(Job& job, const protocol::TileRendered& answer);
    void let_order_go_if_over(Orders::iterator order);
    void count_grant_of_order(const JobId& job, bool begins);
    void end_order(Job& job, protocol::JobPhase phase, protocol::FailureCode fault);

    // stream.cpp: who hears of it
    void on(const TopicSubscribed& event);
    void on(const TopicUnsubscribed& event);
    void on(const Tick&) {}
    void publish_digests();
    void publish_farm_state();
    void publish_state(const Job& job);
    [[nodiscard]] protocol::JobState brief_state(const Job& job) const;
    [[nodiscard]] protocol::WorkerState brief_state(const WorkerSession& worker) const;
    [[nodiscard]] protocol::BrokerState broker_state() const;
    [[nodiscard]] protocol::WorkerState worker_state(const WorkerSession& worker) const;
    [[nodiscard]] std::uint64_t epoch_of(const Job& job) const;
    [[nodiscard]] std::uint64_t epoch_of_tiles(const Job& job) const;
    [[nodiscard]] protocol::TileDone as_sent_now(const Job& job, protocol::TileDone tile) const;
    /// Of tiles that came until then.
    void repair(const PeerId& peer, const protocol::Repair& repair,
                Instant until = Instant::never());
    [[nodiscard]] bool wants_digest(const Job& job) const;

    // figures.cpp: in numbers
    void count_brokers(Figures& all) const;
    void count_jobs(Figures& all) const;
    void count_workers(Figures& all) const;

    void send(const PeerId& peer, protocol::Message message);
    [[nodiscard]] protocol::Version version_of(const PeerId& peer) const;
    [[nodiscard]] bool may_follow(const PeerId& peer, const Job& job) const;
    void log(Log line);

    Identity identity_;
    Limits limits_;
    Counters counters_;
    Once refusals_told_;

    Membership membership_;
    std::map<std::string, Line> lines_;   ///< by endpoint
    std::set<std::string> own_endpoints_; ///< that turned out to lead here
    std::map<BrokerId, Colleague> colleagues_;
    std::map<PeerId, BrokerId> brokers_by_peer_;
    protocol::Term heeded_term_;
    std::map<WorkerId, std::string> liars_;      ///< by drawer_of, with the reason
    std::set<WorkerId> pardoned_;                ///< likewise: what jobs say of them is forgiven
    std::vector<protocol::Member> told_members_; ///< the last that were told
    BrokerId told_leader_;                       ///< likewise, in the log
    Instant next_company_{};
    std::optional<Instant> gathers_until_; ///< while workers say what they have in hand
    bool follows_ = false;                 ///< as long as a Following is there
    std::set<JobId> changed_jobs_;         ///< in this step
    struct Fetch {
        BrokerId from;
        Instant asked_at;
    };
    std::map<ContentHash, Fetch> fetches_; ///< of scenes, from other brokers
    std::uint32_t parties_ = 0;            ///< that there ever were

    Workers workers_;
    std::map<WorkerId, PeerId> peer_of_worker_;
    std::map<WorkerId, Absent> absent_;
    std::map<PeerId, ClientSession> clients_;
    std::map<PeerId, protocol::Version> older_peers_; ///< of these and workers_
    struct Speaker {
        PeerId peer;
        protocol::Version version = protocol::version;
    };
    Speaker speaker_; ///< the last one, whether it has a session or not
    std::set<std::pair<std::uint64_t, PeerId>>
        free_workers_;                    ///< with credit left, the least loaded first
    std::size_t workers_with_credit_ = 0; ///< whose room is not 0
    std::uint64_t threads_with_credit_ = 0;
    double capacity_ = 0;        ///< of these: work in a second
    double worth_of_rays_ = 1;   ///< as CostMap::set_worth wants it
    Speed speed_;                ///< of a thread, of all that was ever here
    std::uint32_t attempts_ = 0; ///< RenderTiles ever sent
    FetchTimes fetch_times_;
    Instant held_back_until_ = Instant::never(); ///< then some job's tiles are anybody's
    std::vector<PeerId> changed_workers_;        ///< have more room, or other work, than a step ago

    std::map<JobId, Job> jobs_;
    std::map<FilmId, std::weak_ptr<Party>> films_;  ///< whose jobs are here
    ReadyJobs ready_;                               ///< jobs with pending tiles
    std::set<std::pair<Instant, JobId>> deadlines_; ///< of jobs with a time limit, not over
    std::map<std::uint32_t, JobId> job_by_number_;
    std::uint32_t last_number_ = 0;
    BlobStore blobs_;
    Orders orders_;
    std::uint32_t last_order_ = 0; ///< number
    /// Together they share the farm with others as one.
    std::shared_ptr<Party> orders_party_ = std::make_shared<Party>(0, protocol::Wishes{});

    std::uint64_t persisted_ = 0;   ///< the last sequence
    std::deque<Unstored> unstored_; ///< in order
    std::uint64_t unstored_bytes_ = 0;
    std::string store_trouble_; ///< why nothing can be kept; empty: all is well
    std::set<JobId> forgotten_;
    std::deque<JobId> forgotten_in_order_; ///< the oldest first

    std::set<JobId> subscribed_jobs_;
    bool farm_subscribed_ = false;

    Instant now_;
    Instant next_sweep_{}, next_digest_{}, next_farm_state_{}, next_overbook_{}, overbooked_at_{};
    std::vector<Action>* actions_ = nullptr; ///< during a step
};

} // namespace fraja::broker
