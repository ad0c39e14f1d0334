// The messages, in the order of PROTOCOL.md, which says what they mean and who answers what.
// A test reads that page and fails when the two drift.
#pragma once

#include "common/base/bytes.hpp"
#include "common/base/ids.hpp"
#include "common/base/instant.hpp"
#include "common/base/pixel_rect.hpp"
#include "common/protocol/fields.hpp"
#include "common/protocol/settings.hpp"

#include <cstdint>
#include <string>
#include <string_view>
#include <tuple>
#include <variant>
#include <vector>

namespace fraja::protocol {

/// Of the header frame. Of any two releases next to each other, the newer one speaks the older
/// one's version as well; other peers are refused.
inline constexpr Version version = 12;
inline constexpr Version oldest_version_spoken = version - 1;
[[nodiscard]] constexpr bool is_spoken(Version v) {
    return v >= oldest_version_spoken && v <= version;
}

// ------------------------------------------------------------------------------- parts of messages

/// a + b, or the largest number where that is more: a peer's counts are its own affair.
[[nodiscard]] constexpr std::uint64_t saturating_sum(std::uint64_t a, std::uint64_t b) {
    return a + b < a ? UINT64_MAX : a + b;
}

/// Rays traced, by kind, and what else they cost. Sums stay at the largest number.
struct Rays {
    std::uint64_t camera = 0, reflected = 0, refracted = 0, shadow = 0;
    // of the fast kernel alone
    std::uint64_t box_tests = 0, form_tests = 0, shaded = 0;
    std::uint64_t skipped_pixels = 0, truncated_pixels = 0;
    friend bool operator==(const Rays&, const Rays&) = default;
    template <class T = Rays>
    static constexpr auto fields() {
        return std::tuple{Field{"camera", &T::camera},
                          Field{"reflected", &T::reflected},
                          Field{"refracted", &T::refracted},
                          Field{"shadow", &T::shadow},
                          Field{"box_tests", &T::box_tests},
                          Field{"form_tests", &T::form_tests},
                          Field{"shaded", &T::shaded},
                          Field{"skipped_pixels", &T::skipped_pixels},
                          Field{"truncated_pixels", &T::truncated_pixels}};
    }
    Rays& operator+=(const Rays& o) {
        std::apply(
            [&](const auto&... f) {
                ((this->*f.member = saturating_sum(this->*f.member, o.*f.member)), ...);
            },
            fields());
        return *this;
    }
    /// But for shadow rays.
    [[nodiscard]] std::uint64_t traced() const {
        return saturating_sum(saturating_sum(camera, reflected), refracted);
    }
    [[nodiscard]] std::uint64_t total() const { return saturating_sum(traced(), shadow); }
};

/// A tile that a worker has, and how far it is.
struct TileInFlight {
    JobId job;
    TileIndex tile{};
    AttemptNumber attempt{};
    std::uint64_t rays = 0; ///< traced so far; it must grow, or the tile hangs
    std::uint32_t pass = 0; ///< as in RenderTile
    PixelRect rect{};       ///< empty: it is a probe
    friend bool operator==(const TileInFlight&, const TileInFlight&) = default;
    template <class T = TileInFlight>
    static constexpr auto fields() {
        return std::tuple{Field{"job", &T::job},         Field{"tile", &T::tile},
                          Field{"attempt", &T::attempt}, Field{"rays", &T::rays},
                          Field{"pass", &T::pass, 12},   Field{"rect", &T::rect, 12}};
    }
};

/// Who deals out tiles. Of brokers that know each other the one with the greatest term that anybody
/// has heard of; a broker that stands alone begins one with every start.
struct Term {
    std::uint64_t counter = 0; ///< grows with every change
    BrokerId leader;           ///< where two have come to the same one
    friend auto operator<=>(const Term&, const Term&) = default;
    template <class T = Term>
    static constexpr auto fields() {
        return std::tuple{Field{"counter", &T::counter}, Field{"leader", &T::leader}};
    }
};

/// A broker of several that stand for each other.
struct Member {
    BrokerId broker;
    std::string endpoint; ///< where it can be reached
    friend bool operator==(const Member&, const Member&) = default;
    template <class T = Member>
    static constexpr auto fields() {
        return std::tuple{Field{"broker", &T::broker}, Field{"endpoint", &T::endpoint}};
    }
};

/// Which of two words about a job is the newer one: whoever changes what was wanted of it counts
/// on.
struct Revision {
    std::uint64_t counter = 0;
    BrokerId broker; ///< where two have come to the same count
    friend auto operator<=>(const Revision&, const Revision&) = default;
    template <class T = Revision>
    static constexpr auto fields() {
        return std::tuple{Field{"counter", &T::counter}, Field{"broker", &T::broker}};
    }
};

enum class JobPhase : std::uint8_t {
    waiting_for_scene,
    queued,
    running,
    paused,
    done,
    failed,
    cancelled
};
template <>
struct ValueCount<JobPhase> {
    static constexpr unsigned value = 7;
};
[[nodiscard]] constexpr bool is_over(JobPhase p) {
    return p >= JobPhase::done;
}

enum class RefusalCode : std::uint8_t {
    unknown_peer,     ///< say hello (again) first
    version_mismatch, ///< another protocol version
    malformed,        ///< bytes that are no message
    unexpected,       ///< a message that has no place here
    limit_exceeded,   ///< one of the broker's limits
    no_such_job,
    conflict, ///< the id is taken by something else
    invalid,  ///< the content makes no sense
    no_such_worker,
    not_allowed, ///< the peer's key lacks the role for it
};
template <>
struct ValueCount<RefusalCode> {
    static constexpr unsigned value = 10;
    static constexpr RefusalCode in_words_of(Version spoken, RefusalCode code) {
        return spoken < 12 && code == RefusalCode::not_allowed ? RefusalCode::unexpected : code;
    }
};

enum class FailureCode : std::uint8_t {
    scene,     ///< the scene's fault, as far as this worker can tell: all would fail
    machine,   ///< this worker's fault: another one may do it
    cancelled, ///< nobody's fault: stopped on the broker's word, or handed back by a leaving worker
};
template <>
struct ValueCount<FailureCode> {
    static constexpr unsigned value = 3;
};

/// How a job's tiles are dealt out. It never changes pixels.
enum class Schedule : std::uint8_t {
    demand,   ///< whoever has room gets the next tile, as large as is good then
    equal,    ///< each worker that is here at the start gets an equal share of the pixels
    weighted, ///< shares by what they are thought to cost, and by what their workers can do
    stealing, ///< as equal; whoever is through with its own share takes of the others'
};
template <>
struct ValueCount<Schedule> {
    static constexpr unsigned value = 4;
};

enum class JobDeed : std::uint8_t { cancel, pause, resume, retry, set_priority };
template <>
struct ValueCount<JobDeed> {
    static constexpr unsigned value = 5;
};

enum class WorkerDeed : std::uint8_t {
    drain,   ///< it gets no more tiles
    undrain, ///< it does again; a quarantine ends, too
    kick,    ///< it is told to leave, and its tiles are given to others
};
template <>
struct ValueCount<WorkerDeed> {
    static constexpr unsigned value = 3;
};

/// Beside priority, what is wanted of those who render a job.
struct Wishes {
    Schedule schedule = Schedule::demand;
    std::uint32_t workers_max = 0; ///< at a time; 0: as many as help
    std::vector<std::string> tags; ///< a worker must have each: K or K=V; K alone fits any value
    FilmId film;                   ///< of which this is a frame; zero: it is a single picture
    std::uint32_t frame = 0;       ///< its number there
    double verify = 0;             ///< share of its tiles that another worker draws as well
    friend bool operator==(const Wishes&, const Wishes&) = default;
    template <class T = Wishes>
    static constexpr auto fields() {
        return std::tuple{Field{"schedule", &T::schedule}, Field{"workers_max", &T::workers_max},
                          Field{"tags", &T::tags},         Field{"film", &T::film},
                          Field{"frame", &T::frame},       Field{"verify", &T::verify, 12}};
    }
};

/// A worker that was found to answer wrong pixels: no tile of it counts in that job.
struct Distrusted {
    WorkerId worker;
    std::string worker_name;
    std::string reason;
    friend bool operator==(const Distrusted&, const Distrusted&) = default;
    template <class T = Distrusted>
    static constexpr auto fields() {
        return std::tuple{Field{"worker", &T::worker}, Field{"worker_name", &T::worker_name},
                          Field{"reason", &T::reason}};
    }
};

/// What became of the tiles that were to be checked.
struct CheckCounts {
    std::uint32_t agreed = 0;    ///< two workers have drawn the same
    std::uint32_t unchecked = 0; ///< there was no second worker
    friend bool operator==(const CheckCounts&, const CheckCounts&) = default;
    template <class T = CheckCounts>
    static constexpr auto fields() {
        return std::tuple{Field{"agreed", &T::agreed}, Field{"unchecked", &T::unchecked}};
    }
};

// --------------------------------------------------------------------------------------- sessions

struct WorkerHello {
    static constexpr std::uint16_t type = 1;
    static constexpr std::string_view name = "WorkerHello";
    WorkerId worker;
    std::uint64_t incarnation = 0;
    std::string worker_name;
    std::uint32_t threads = 0;
    std::uint32_t credit = 0;
    double speed_rays_per_s = 0;
    std::uint64_t memory_bytes = 0;
    std::vector<std::string> tags;
    std::string program_version;
    friend bool operator==(const WorkerHello&, const WorkerHello&) = default;
    template <class T = WorkerHello>
    static constexpr auto fields() {
        return std::tuple{Field{"worker", &T::worker},
                          Field{"incarnation", &T::incarnation},
                          Field{"worker_name", &T::worker_name},
                          Field{"threads", &T::threads},
                          Field{"credit", &T::credit},
                          Field{"speed_rays_per_s", &T::speed_rays_per_s},
                          Field{"memory_bytes", &T::memory_bytes},
                          Field{"tags", &T::tags},
                          Field{"program_version", &T::program_version}};
    }
};

struct ClientHello {
    static constexpr std::uint16_t type = 2;
    static constexpr std::string_view name = "ClientHello";
    std::string client_name;
    std::string program_version;
    friend bool operator==(const ClientHello&, const ClientHello&) = default;
    template <class T = ClientHello>
    static constexpr auto fields() {
        return std::tuple{Field{"client_name", &T::client_name},
                          Field{"program_version", &T::program_version}};
    }
};

struct Welcome {
    static constexpr std::uint16_t type = 3;
    static constexpr std::string_view name = "Welcome";
    BrokerId broker;
    std::uint64_t epoch = 0;
    Duration heartbeat{};
    std::uint32_t liveness = 0;
    std::string stream;
    std::string program_version;
    std::uint64_t incarnation = 0;
    Term term{};
    std::vector<Member> brokers{};
    friend bool operator==(const Welcome&, const Welcome&) = default;
    template <class T = Welcome>
    static constexpr auto fields() {
        return std::tuple{
            Field{"broker", &T::broker},           Field{"epoch", &T::epoch},
            Field{"heartbeat", &T::heartbeat},     Field{"liveness", &T::liveness},
            Field{"stream", &T::stream},           Field{"program_version", &T::program_version},
            Field{"incarnation", &T::incarnation}, Field{"term", &T::term, 12},
            Field{"brokers", &T::brokers, 12}};
    }
};

struct Refused {
    static constexpr std::uint16_t type = 4;
    static constexpr std::string_view name = "Refused";
    RefusalCode code{};
    JobId job;
    std::string reason;
    friend bool operator==(const Refused&, const Refused&) = default;
    template <class T = Refused>
    static constexpr auto fields() {
        return std::tuple{Field{"code", &T::code}, Field{"job", &T::job},
                          Field{"reason", &T::reason}};
    }
};

struct Beat {
    static constexpr std::uint16_t type = 5;
    static constexpr std::string_view name = "Beat";
    bool leads = false; ///< of a broker: it hands out the tiles
    friend bool operator==(const Beat&, const Beat&) = default;
    template <class T = Beat>
    static constexpr auto fields() {
        return std::tuple{Field{"leads", &T::leads, 12}};
    }
};

struct WorkerBeat {
    static constexpr std::uint16_t type = 6;
    static constexpr std::string_view name = "WorkerBeat";
    std::uint32_t credit = 0;
    std::vector<TileInFlight> in_flight;
    std::uint64_t tiles_received = 0;
    Term term{}; ///< the greatest it has heard of
    /// Since that term's leader has last said to it that it leads.
    Duration leader_silence = Duration::max();
    friend bool operator==(const WorkerBeat&, const WorkerBeat&) = default;
    template <class T = WorkerBeat>
    static constexpr auto fields() {
        return std::tuple{Field{"credit", &T::credit}, Field{"in_flight", &T::in_flight},
                          Field{"tiles_received", &T::tiles_received}, Field{"term", &T::term, 12},
                          Field{"leader_silence", &T::leader_silence, 12}};
    }
};

struct Goodbye {
    static constexpr std::uint16_t type = 7;
    static constexpr std::string_view name = "Goodbye";
    friend bool operator==(const Goodbye&, const Goodbye&) = default;
    static constexpr auto fields() { return std::tuple{}; }
};

struct Dismissed {
    static constexpr std::uint16_t type = 8;
    static constexpr std::string_view name = "Dismissed";
    std::string reason;
    friend bool operator==(const Dismissed&, const Dismissed&) = default;
    static constexpr auto fields() { return std::tuple{Field{"reason", &Dismissed::reason}}; }
};

struct Brokers {
    static constexpr std::uint16_t type = 9;
    static constexpr std::string_view name = "Brokers";
    static constexpr Version since = 12;
    Term term;
    std::vector<Member> brokers;
    friend bool operator==(const Brokers&, const Brokers&) = default;
    template <class T = Brokers>
    static constexpr auto fields() {
        return std::tuple{Field{"term", &T::term}, Field{"brokers", &T::brokers}};
    }
};

// -------------------------------------------------------------------------------- scenes as blobs

struct NeedChunk {
    static constexpr std::uint16_t type = 10;
    static constexpr std::string_view name = "NeedChunk";
    ContentHash blob;
    std::uint64_t offset_bytes = 0;
    friend bool operator==(const NeedChunk&, const NeedChunk&) = default;
    template <class T = NeedChunk>
    static constexpr auto fields() {
        return std::tuple{Field{"blob", &T::blob}, Field{"offset_bytes", &T::offset_bytes}};
    }
};

struct Chunk {
    static constexpr std::uint16_t type = 11;
    static constexpr std::string_view name = "Chunk";
    ContentHash blob;
    std::uint64_t offset_bytes = 0;
    std::uint64_t total_bytes = 0;
    std::vector<Blob> blobs; ///< exactly one
    template <class T = Chunk>
    static constexpr auto fields() {
        return std::tuple{Field{"blob", &T::blob}, Field{"offset_bytes", &T::offset_bytes},
                          Field{"total_bytes", &T::total_bytes}};
    }
};

// -------------------------------------------------------------------------------------------- jobs

struct SubmitJob {
    static constexpr std::uint16_t type = 20;
    static constexpr std::string_view name = "SubmitJob";
    JobId job;
    std::string job_name;
    ContentHash scene;
    std::uint64_t scene_bytes = 0;
    PictureSettings settings;
    std::uint32_t tile_side = 0;
    TileOrder order = TileOrder::automatic;
    std::int32_t priority = 0;
    Wishes wishes;
    bool resume = false;
    friend bool operator==(const SubmitJob&, const SubmitJob&) = default;
    template <class T = SubmitJob>
    static constexpr auto fields() {
        return std::tuple{Field{"job", &T::job},           Field{"job_name", &T::job_name},
                          Field{"scene", &T::scene},       Field{"scene_bytes", &T::scene_bytes},
                          Field{"settings", &T::settings}, Field{"tile_side", &T::tile_side},
                          Field{"order", &T::order},       Field{"priority", &T::priority},
                          Field{"wishes", &T::wishes},     Field{"resume", &T::resume}};
    }
};

struct JobState {
    static constexpr std::uint16_t type = 21;
    static constexpr std::string_view name = "JobState";
    std::uint64_t epoch = 0;
    JobId job;
    std::uint32_t number = 0;
    std::string job_name;
    JobPhase phase{};
    std::string reason;
    ContentHash scene;
    PictureSettings settings;
    std::uint32_t cell_side = 0;
    std::uint32_t cell_count = 0;
    std::uint32_t done_count = 0;
    double share_done = 0;
    double share_per_s = 0;
    std::int32_t priority = 0;
    std::uint32_t in_flight_count = 0;
    std::uint32_t worker_count = 0;
    std::uint32_t film_worker_count = 0; ///< of all frames of its film together
    Rays rays;
    Duration render_time{};
    Duration elapsed{};
    FilmId film;
    std::uint32_t frame = 0;
    CheckCounts checks;
    std::vector<Distrusted> distrusted;
    double verify = 0;
    Revision revision;
    std::uint32_t copies = 0;        ///< other brokers that are here and have it
    std::uint32_t copies_wanted = 0; ///< other brokers, as far as is known
    friend bool operator==(const JobState&, const JobState&) = default;
    template <class T = JobState>
    static constexpr auto fields() {
        return std::tuple{Field{"epoch", &T::epoch},
                          Field{"job", &T::job},
                          Field{"number", &T::number},
                          Field{"job_name", &T::job_name},
                          Field{"phase", &T::phase},
                          Field{"reason", &T::reason},
                          Field{"scene", &T::scene},
                          Field{"settings", &T::settings},
                          Field{"cell_side", &T::cell_side},
                          Field{"cell_count", &T::cell_count},
                          Field{"done_count", &T::done_count},
                          Field{"share_done", &T::share_done},
                          Field{"share_per_s", &T::share_per_s},
                          Field{"priority", &T::priority},
                          Field{"in_flight_count", &T::in_flight_count},
                          Field{"worker_count", &T::worker_count},
                          Field{"film_worker_count", &T::film_worker_count},
                          Field{"rays", &T::rays},
                          Field{"render_time", &T::render_time},
                          Field{"elapsed", &T::elapsed},
                          Field{"film", &T::film},
                          Field{"frame", &T::frame},
                          Field{"checks", &T::checks, 12},
                          Field{"distrusted", &T::distrusted, 12},
                          Field{"verify", &T::verify, 12},
                          Field{"revision", &T::revision, 12},
                          Field{"copies", &T::copies, 12},
                          Field{"copies_wanted", &T::copies_wanted, 12}};
    }
};

struct FindJob {
    static constexpr std::uint16_t type = 22;
    static constexpr std::string_view name = "FindJob";
    std::string what;
    friend bool operator==(const FindJob&, const FindJob&) = default;
    static constexpr auto fields() { return std::tuple{Field{"what", &FindJob::what}}; }
};

struct ControlJob {
    static constexpr std::uint16_t type = 23;
    static constexpr std::string_view name = "ControlJob";
    JobId job;
    JobDeed deed{};
    std::int32_t priority = 0; ///< to set
    friend bool operator==(const ControlJob&, const ControlJob&) = default;
    template <class T = ControlJob>
    static constexpr auto fields() {
        return std::tuple{Field{"job", &T::job}, Field{"deed", &T::deed},
                          Field{"priority", &T::priority}};
    }
};

struct Repair {
    static constexpr std::uint16_t type = 24;
    static constexpr std::string_view name = "Repair";
    JobId job;
    std::uint32_t tiles_max = 0;
    Bytes have;
    friend bool operator==(const Repair&, const Repair&) = default;
    template <class T = Repair>
    static constexpr auto fields() {
        return std::tuple{Field{"job", &T::job}, Field{"tiles_max", &T::tiles_max},
                          Field{"have", &T::have}};
    }
};

struct RepairDone {
    static constexpr std::uint16_t type = 25;
    static constexpr std::string_view name = "RepairDone";
    JobState state;
    std::uint32_t remaining_count = 0;
    friend bool operator==(const RepairDone&, const RepairDone&) = default;
    template <class T = RepairDone>
    static constexpr auto fields() {
        return std::tuple{Field{"state", &T::state}, Field{"remaining_count", &T::remaining_count}};
    }
};

struct ControlWorker {
    static constexpr std::uint16_t type = 26;
    static constexpr std::string_view name = "ControlWorker";
    std::string what;
    WorkerDeed deed{};
    friend bool operator==(const ControlWorker&, const ControlWorker&) = default;
    template <class T = ControlWorker>
    static constexpr auto fields() {
        return std::tuple{Field{"what", &T::what}, Field{"deed", &T::deed}};
    }
};

// ------------------------------------------------------------------------------------------- tiles

struct RenderTile {
    static constexpr std::uint16_t type = 30;
    static constexpr std::string_view name = "RenderTile";
    JobId job;
    TileIndex tile{};
    AttemptNumber attempt{};
    std::uint32_t frame = 0;
    std::uint32_t pass = 0;
    PixelRect rect;
    ContentHash scene;
    std::uint64_t scene_bytes = 0;
    PictureSettings settings;
    std::uint32_t probe_side = 0;
    Term term{};
    friend bool operator==(const RenderTile&, const RenderTile&) = default;
    template <class T = RenderTile>
    static constexpr auto fields() {
        return std::tuple{Field{"job", &T::job},           Field{"tile", &T::tile},
                          Field{"attempt", &T::attempt},   Field{"frame", &T::frame},
                          Field{"pass", &T::pass},         Field{"rect", &T::rect},
                          Field{"scene", &T::scene},       Field{"scene_bytes", &T::scene_bytes},
                          Field{"settings", &T::settings}, Field{"probe_side", &T::probe_side},
                          Field{"term", &T::term, 12}};
    }
};

struct TileRendered {
    static constexpr std::uint16_t type = 31;
    static constexpr std::string_view name = "TileRendered";
    JobId job;
    TileIndex tile{};
    AttemptNumber attempt{};
    Rays rays;
    Duration elapsed{};
    std::uint32_t pass = 0;
    PixelRect rect{};        ///< empty: it is a probe
    std::vector<Blob> blobs; ///< the pixels, cut into frames
    template <class T = TileRendered>
    static constexpr auto fields() {
        return std::tuple{Field{"job", &T::job},         Field{"tile", &T::tile},
                          Field{"attempt", &T::attempt}, Field{"rays", &T::rays},
                          Field{"elapsed", &T::elapsed}, Field{"pass", &T::pass, 12},
                          Field{"rect", &T::rect, 12}};
    }
};

struct TileFailed {
    static constexpr std::uint16_t type = 32;
    static constexpr std::string_view name = "TileFailed";
    JobId job;
    TileIndex tile{};
    AttemptNumber attempt{};
    FailureCode code{};
    std::string reason;
    friend bool operator==(const TileFailed&, const TileFailed&) = default;
    template <class T = TileFailed>
    static constexpr auto fields() {
        return std::tuple{Field{"job", &T::job}, Field{"tile", &T::tile},
                          Field{"attempt", &T::attempt}, Field{"code", &T::code},
                          Field{"reason", &T::reason}};
    }
};

struct CancelTile {
    static constexpr std::uint16_t type = 33;
    static constexpr std::string_view name = "CancelTile";
    JobId job;
    TileIndex tile{};
    AttemptNumber attempt{};
    friend bool operator==(const CancelTile&, const CancelTile&) = default;
    template <class T = CancelTile>
    static constexpr auto fields() {
        return std::tuple{Field{"job", &T::job}, Field{"tile", &T::tile},
                          Field{"attempt", &T::attempt}};
    }
};

// -------------------------------------------------------------------------------------- the stream

struct TileDone {
    static constexpr std::uint16_t type = 40;
    static constexpr std::string_view name = "TileDone";
    JobId job;
    TileIndex tile{};
    std::uint32_t frame = 0;
    std::uint32_t pass = 0;
    PixelRect rect;
    std::string worker_name;
    Rays rays;
    Duration elapsed{};
    WorkerId worker{};
    std::uint64_t epoch = 0; ///< in which it was sent; 0: not known
    std::vector<Blob> blobs; ///< the pixels, cut into frames
    template <class T = TileDone>
    static constexpr auto fields() {
        return std::tuple{Field{"job", &T::job},           Field{"tile", &T::tile},
                          Field{"frame", &T::frame},       Field{"pass", &T::pass},
                          Field{"rect", &T::rect},         Field{"worker_name", &T::worker_name},
                          Field{"rays", &T::rays},         Field{"elapsed", &T::elapsed},
                          Field{"worker", &T::worker, 12}, Field{"epoch", &T::epoch, 12}};
    }
};

struct Barrier {
    static constexpr std::uint16_t type = 41;
    static constexpr std::string_view name = "Barrier";
    Nonce nonce;
    std::uint64_t epoch = 0;
    friend bool operator==(const Barrier&, const Barrier&) = default;
    template <class T = Barrier>
    static constexpr auto fields() {
        return std::tuple{Field{"nonce", &T::nonce}, Field{"epoch", &T::epoch}};
    }
};

struct WorkerState {
    WorkerId worker;
    std::string worker_name;
    std::string program_version;
    std::uint32_t threads = 0;
    std::uint32_t credit = 0;
    std::uint32_t in_flight_count = 0;
    std::uint64_t tiles_done = 0;
    Rays rays;
    bool draining = false;
    Duration quarantined{};
    std::vector<std::string> tags;
    std::string distrusted;
    friend bool operator==(const WorkerState&, const WorkerState&) = default;
    template <class T = WorkerState>
    static constexpr auto fields() {
        return std::tuple{Field{"worker", &T::worker},
                          Field{"worker_name", &T::worker_name},
                          Field{"program_version", &T::program_version},
                          Field{"threads", &T::threads},
                          Field{"credit", &T::credit},
                          Field{"in_flight_count", &T::in_flight_count},
                          Field{"tiles_done", &T::tiles_done},
                          Field{"rays", &T::rays},
                          Field{"draining", &T::draining},
                          Field{"quarantined", &T::quarantined},
                          Field{"tags", &T::tags},
                          Field{"distrusted", &T::distrusted, 12}};
    }
};

struct BrokerState {
    BrokerId broker;
    std::string program_version;
    Duration uptime{};
    Duration unix_time{};
    bool keeps = false;
    std::string trouble;
    std::uint64_t jobs = 0;
    std::uint64_t jobs_ready = 0;
    std::uint64_t workers = 0;
    std::uint64_t threads = 0;
    std::uint64_t clients = 0;
    std::uint64_t tiles_in_flight = 0;
    std::uint64_t jobs_done = 0;
    std::uint64_t jobs_failed = 0;
    std::uint64_t jobs_cancelled = 0;
    std::uint64_t tiles_done = 0;
    std::uint64_t tiles_failed = 0;
    std::uint64_t tiles_requeued = 0;
    std::uint64_t tiles_overbooked = 0;
    std::uint64_t workers_lost = 0;
    Rays rays;
    Duration render_time{};
    std::uint64_t tiles_checked = 0;
    std::uint64_t workers_distrusted = 0;
    friend bool operator==(const BrokerState&, const BrokerState&) = default;
    template <class T = BrokerState>
    static constexpr auto fields() {
        return std::tuple{Field{"broker", &T::broker},
                          Field{"program_version", &T::program_version},
                          Field{"uptime", &T::uptime},
                          Field{"unix_time", &T::unix_time},
                          Field{"keeps", &T::keeps},
                          Field{"trouble", &T::trouble},
                          Field{"jobs", &T::jobs},
                          Field{"jobs_ready", &T::jobs_ready},
                          Field{"workers", &T::workers},
                          Field{"threads", &T::threads},
                          Field{"clients", &T::clients},
                          Field{"tiles_in_flight", &T::tiles_in_flight},
                          Field{"jobs_done", &T::jobs_done},
                          Field{"jobs_failed", &T::jobs_failed},
                          Field{"jobs_cancelled", &T::jobs_cancelled},
                          Field{"tiles_done", &T::tiles_done},
                          Field{"tiles_failed", &T::tiles_failed},
                          Field{"tiles_requeued", &T::tiles_requeued},
                          Field{"tiles_overbooked", &T::tiles_overbooked},
                          Field{"workers_lost", &T::workers_lost},
                          Field{"rays", &T::rays},
                          Field{"render_time", &T::render_time},
                          Field{"tiles_checked", &T::tiles_checked, 12},
                          Field{"workers_distrusted", &T::workers_distrusted, 12}};
    }
};

/// One of several brokers, as the one that tells of it sees it.
struct PeerState {
    BrokerId broker; ///< zero: it was never heard of
    std::string endpoint;
    std::string program_version;
    bool is_here = false;   ///< it has been heard of late
    bool is_synced = false; ///< it has what the others have
    bool leads = false;     ///< it deals out the tiles
    friend bool operator==(const PeerState&, const PeerState&) = default;
    template <class T = PeerState>
    static constexpr auto fields() {
        return std::tuple{Field{"broker", &T::broker},
                          Field{"endpoint", &T::endpoint},
                          Field{"program_version", &T::program_version},
                          Field{"is_here", &T::is_here},
                          Field{"is_synced", &T::is_synced},
                          Field{"leads", &T::leads}};
    }
};

struct FarmState {
    static constexpr std::uint16_t type = 42;
    static constexpr std::string_view name = "FarmState";
    std::uint64_t epoch = 0;
    std::vector<JobState> jobs;
    std::vector<WorkerState> workers;
    BrokerState broker;
    std::vector<PeerState> brokers{}; ///< itself first
    friend bool operator==(const FarmState&, const FarmState&) = default;
    template <class T = FarmState>
    static constexpr auto fields() {
        return std::tuple{Field{"epoch", &T::epoch}, Field{"jobs", &T::jobs},
                          Field{"workers", &T::workers}, Field{"broker", &T::broker},
                          Field{"brokers", &T::brokers, 12}};
    }
};

// ------------------------------------------------------------------------------ among brokers

struct BrokerHello {
    static constexpr std::uint16_t type = 50;
    static constexpr std::string_view name = "BrokerHello";
    static constexpr Version since = 12;
    BrokerId broker;
    Duration started_at{}; ///< since 1970
    std::string endpoint;
    std::string program_version;
    bool keeps = false;
    friend bool operator==(const BrokerHello&, const BrokerHello&) = default;
    template <class T = BrokerHello>
    static constexpr auto fields() {
        return std::tuple{Field{"broker", &T::broker}, Field{"started_at", &T::started_at},
                          Field{"endpoint", &T::endpoint},
                          Field{"program_version", &T::program_version}, Field{"keeps", &T::keeps}};
    }
};

struct BrokerBeat {
    static constexpr std::uint16_t type = 51;
    static constexpr std::string_view name = "BrokerBeat";
    static constexpr Version since = 12;
    BrokerId broker;
    Term term;
    bool is_synced = false;
    std::vector<Member> brokers;
    std::uint64_t digest = 0;
    bool leads = false;
    bool has_workers = false;                  ///< for a while; or it has had some until lately
    Duration leader_silence = Duration::max(); ///< as in WorkerBeat
    friend bool operator==(const BrokerBeat&, const BrokerBeat&) = default;
    template <class T = BrokerBeat>
    static constexpr auto fields() {
        return std::tuple{
            Field{"broker", &T::broker},           Field{"term", &T::term},
            Field{"is_synced", &T::is_synced},     Field{"brokers", &T::brokers},
            Field{"digest", &T::digest},           Field{"leads", &T::leads},
            Field{"has_workers", &T::has_workers}, Field{"leader_silence", &T::leader_silence}};
    }
};

/// What a broker has of a job, in short.
struct JobDigest {
    JobId job;
    Revision revision;
    std::uint64_t cells = 0; ///< a hash of the cells that are done
    friend bool operator==(const JobDigest&, const JobDigest&) = default;
    template <class T = JobDigest>
    static constexpr auto fields() {
        return std::tuple{Field{"job", &T::job}, Field{"revision", &T::revision},
                          Field{"cells", &T::cells}};
    }
};

struct CompareJobs {
    static constexpr std::uint16_t type = 52;
    static constexpr std::string_view name = "CompareJobs";
    static constexpr Version since = 12;
    friend bool operator==(const CompareJobs&, const CompareJobs&) = default;
    static constexpr auto fields() { return std::tuple{}; }
};

struct JobDigests {
    static constexpr std::uint16_t type = 53;
    static constexpr std::string_view name = "JobDigests";
    static constexpr Version since = 12;
    std::vector<JobDigest> jobs;
    std::uint64_t epoch = 0; ///< in which it was sent
    friend bool operator==(const JobDigests&, const JobDigests&) = default;
    template <class T = JobDigests>
    static constexpr auto fields() {
        return std::tuple{Field{"jobs", &T::jobs}, Field{"epoch", &T::epoch}};
    }
};

struct WantJob {
    static constexpr std::uint16_t type = 54;
    static constexpr std::string_view name = "WantJob";
    static constexpr Version since = 12;
    JobId job;
    friend bool operator==(const WantJob&, const WantJob&) = default;
    static constexpr auto fields() { return std::tuple{Field{"job", &WantJob::job}}; }
};

struct JobRecord {
    static constexpr std::uint16_t type = 55;
    static constexpr std::string_view name = "JobRecord";
    static constexpr Version since = 12;
    SubmitJob submission;
    Revision revision;
    std::uint32_t number = 0;
    std::uint32_t passes = 0;
    JobPhase phase{};
    std::string reason;
    std::int32_t priority = 0;
    std::uint32_t done_count = 0;
    Duration age{};
    Duration elapsed{};
    Duration over_for{};
    CheckCounts checks;
    std::vector<Distrusted> distrusted;
    std::uint64_t epoch = 0; ///< in which it was sent
    friend bool operator==(const JobRecord&, const JobRecord&) = default;
    template <class T = JobRecord>
    static constexpr auto fields() {
        return std::tuple{Field{"submission", &T::submission},
                          Field{"revision", &T::revision},
                          Field{"number", &T::number},
                          Field{"passes", &T::passes},
                          Field{"phase", &T::phase},
                          Field{"reason", &T::reason},
                          Field{"priority", &T::priority},
                          Field{"done_count", &T::done_count},
                          Field{"age", &T::age},
                          Field{"elapsed", &T::elapsed},
                          Field{"over_for", &T::over_for},
                          Field{"checks", &T::checks},
                          Field{"distrusted", &T::distrusted},
                          Field{"epoch", &T::epoch}};
    }
};

struct JobKept {
    static constexpr std::uint16_t type = 56;
    static constexpr std::string_view name = "JobKept";
    static constexpr Version since = 12;
    JobId job;
    friend bool operator==(const JobKept&, const JobKept&) = default;
    static constexpr auto fields() { return std::tuple{Field{"job", &JobKept::job}}; }
};

struct JobForgotten {
    static constexpr std::uint16_t type = 57;
    static constexpr std::string_view name = "JobForgotten";
    static constexpr Version since = 12;
    JobId job;
    friend bool operator==(const JobForgotten&, const JobForgotten&) = default;
    static constexpr auto fields() { return std::tuple{Field{"job", &JobForgotten::job}}; }
};

using MessageVariant =
    std::variant<WorkerHello, ClientHello, Welcome, Refused, Beat, WorkerBeat, Goodbye, Dismissed,
                 Brokers, NeedChunk, Chunk, SubmitJob, JobState, FindJob, ControlJob, Repair,
                 RepairDone, ControlWorker, RenderTile, TileRendered, TileFailed, CancelTile,
                 TileDone, Barrier, FarmState, BrokerHello, BrokerBeat, CompareJobs, JobDigests,
                 WantJob, JobRecord, JobKept, JobForgotten>;

/// A class of its own, so that what copies, moves and destroys any of them is compiled once.
struct Message : MessageVariant {
    using MessageVariant::MessageVariant;
    using MessageVariant::operator=;
    Message();
    Message(const Message&);
    Message(Message&&) noexcept;
    Message& operator=(const Message&);
    Message& operator=(Message&&) noexcept;
    ~Message();
};

template <class M>
concept CarriesBlobs = requires(M m) {
    m.blobs;
};

/// The version that a message came with; 0: one that is not spoken any more.
template <class M>
inline constexpr Version since = [] {
    if constexpr (requires { M::since; })
        return M::since;
    else
        return Version{0};
}();
[[nodiscard]] inline bool is_known_to(Version spoken, const Message& message) {
    return std::visit([&]<class M>(const M&) { return since<M> <= spoken; }, message);
}

[[nodiscard]] inline std::string_view name_of(const Message& message) {
    return std::visit([](const auto& m) { return m.name; }, message);
}

} // namespace fraja::protocol
