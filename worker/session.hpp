// Session: what a worker says to one broker and does for it; of a worker that is called, to one
// broker after the other. It decides and moves nothing: time,
// messages and rendered tiles arrive as events, and what must be done leaves as actions.
#pragma once

#include "common/base/bytes.hpp"
#include "common/base/ids.hpp"
#include "common/base/instant.hpp"
#include "common/base/result.hpp"
#include "common/base/rng.hpp"
#include "common/protocol/messages.hpp"
#include "worker/options.hpp"
#include "worker/scene_shelf.hpp"

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace fraja::worker {

/// Who greets the broker.
struct Identity {
    WorkerId worker;
    std::string name;
    std::uint32_t threads = 1;
    std::vector<std::string> tags;
    /// Brokers call this worker and come and go. So none of them can end it.
    bool is_called = false;
    std::uint64_t memory_bytes = 0; ///< it may have; 0: no limit is known
};

struct Limits {
    /// Tiles that wait here for each thread, so that none idles for a round trip.
    std::uint32_t prefetch_per_thread = 1;
    /// Between two unanswered hellos: doubling from the first to the second, each time a random
    /// part of up to a half less.
    Duration hello_pause_min = std::chrono::seconds(1), hello_pause_max = std::chrono::seconds(5);
    /// Hellos without an answer until it is another caller's turn.
    std::uint32_t hellos_per_turn = 3;
    /// What a Welcome may ask for; beyond, it is taken as the nearest of these.
    Duration heartbeat_min = std::chrono::milliseconds(1), heartbeat_max = std::chrono::hours(1);
    std::uint32_t liveness_max = 1000;
    /// A chunk that has not come after so many heartbeats is asked for again, so many times in all.
    std::uint32_t chunk_patience_beats = 3, chunk_asks_max = 5;
    /// How long a leaving worker that has nothing left waits for the broker to have heard all.
    Duration farewell_max = std::chrono::seconds(1);
    ShelfLimits shelf;
};

/// Tiles a worker of so many threads takes in flight.
[[nodiscard]] std::uint32_t credit_for(std::uint32_t threads, const Limits& limits);

/// Which of a process's sessions: their tickets and scenes are kept apart.
enum class SessionIndex : std::uint32_t {};

/// Names a tile between a session and the render threads. Never used twice.
enum class Ticket : std::uint64_t {};

// ------------------------------------------------------------------------------------------ events

struct Received {
    protocol::Message message;                     ///< from the broker
    protocol::Version version = protocol::version; ///< that it was said in
};
/// From the broker came what decode() refused. Or nothing comes (ErrorCode::refused): who listens
/// there does not let this worker in, which is tried again meanwhile.
struct Undecodable {
    Error error;
};
struct SceneCompiled {
    ContentHash scene;
};
/// invalid_scene, unresolved_overlap and limit_exceeded are the scene's fault: every worker would
/// fail. Everything else is this machine's.
struct SceneFailed {
    ContentHash scene;
    Error error;
};
struct TileFinished {
    Ticket ticket{};
    protocol::Rays rays;
    Duration elapsed{};
    std::vector<Blob> blobs; ///< as in protocol::TileRendered, also of a probe
};
/// Whose fault it is: as in SceneFailed.
struct TileBroken {
    Ticket ticket{};
    Error error;
};
struct TileProgress {
    Ticket ticket{};
    std::uint64_t rays = 0; ///< traced so far
};
/// Of a worker that is called: the broker is gone. Whoever hears what is said from now on is
/// another one.
struct CallerGone {};
/// Time has passed, and so far are the running tiles. Nothing happens for time's sake alone but
/// here: so every beat tells the newest progress, and what has arrived is heard before silence is
/// judged.
struct Tick {
    std::vector<TileProgress> progress;
};
struct Drain {};   ///< take nothing more, finish what is here, leave
struct StopNow {}; ///< hand back what is here, leave

using Event = std::variant<Received, Undecodable, SceneCompiled, SceneFailed, TileFinished,
                           TileBroken, CallerGone, Tick, Drain, StopNow>;

// ----------------------------------------------------------------------------------------- actions

/// A WorkerHello opens a new session: what was to be sent before it and has not left is void.
struct Send {
    protocol::Message message;
    protocol::Version version = protocol::version; ///< that the broker speaks
};
/// Check that the chunks, one after the other, have this hash, and make them ready for rendering
/// with the kernel that the first tile asks for. Answered by SceneCompiled or SceneFailed.
struct CompileScene {
    ContentHash scene;
    std::vector<Blob> chunks;
    protocol::KernelChoice kernel{};
};
/// Answered by TileFinished or TileBroken, unless stopped. The scene is compiled, if only for
/// another kernel than this tile's settings name.
struct StartTile {
    Ticket ticket{};
    ContentHash scene;
    std::uint32_t pass = 0;
    PixelRect rect;
    protocol::PictureSettings settings;
    std::uint32_t probe_side = 0; ///< as in protocol::RenderTile
};
/// An answer is not wanted any more.
struct StopTile {
    Ticket ticket{};
};
/// No tile will be started with this scene until it is compiled again.
struct ForgetScene {
    ContentHash scene;
};
/// It is the next broker's turn. CallerGone follows.
struct HangUp {
    bool for_good = false; ///< otherwise this one has its turn again, after the others
};
using Log = LogLine; ///< about the session itself: it names no subject
enum class FinishReason : std::uint8_t {
    drained,
    stopped,          ///< tiles were handed back
    version_mismatch, ///< the broker speaks another protocol version
    dismissed,        ///< the broker told it to leave
};
/// The last action ever: the session is over.
struct Finished {
    FinishReason reason{};
};

using Action =
    std::variant<Send, CompileScene, StartTile, StopTile, ForgetScene, HangUp, Log, Finished>;

// ----------------------------------------------------------------------------------------- session

class Session {
public:
    Session(Identity identity, const Limits& limits);

    /// Takes in one event and appends what must now be done. Same history, same actions.
    void step(Instant now, const Event& event, std::vector<Action>& actions);
    /// When a Tick is due; it may be at once. The zero instant before the first step.
    [[nodiscard]] Instant next_deadline() const;

    // Of a worker that serves several brokers; a session that is alone needs none of these. Its
    // allies are the worker's sessions with brokers that stand for this one's. A Crew has them
    // meet.

    /// From now on these are its allies; they must be there until others are named.
    void set_allies(std::vector<const Session*> allies) {
        allies_ = std::move(allies);
        is_of_several_ = is_of_several_ || !allies_.empty();
    }
    /// The sessions of one worker count their tickets together.
    void share_tickets(std::uint64_t& last_ticket) { shared_tickets_ = &last_ticket; }
    /// Its hellos come after those of an earlier session with the same broker. Before the first
    /// step.
    void begin_after(std::uint64_t incarnation) { incarnation_ = incarnation; }
    /// Of the last hello.
    [[nodiscard]] std::uint64_t incarnation() const { return incarnation_; }
    /// The version in which it speaks to the broker now.
    [[nodiscard]] protocol::Version spoken() const { return spoken_; }
    /// So far are the running tiles.
    /// No ally's broker has told of a later one.
    [[nodiscard]] bool has_newest_term() const { return !(term_ < greatest_term()); }
    void note_progress(const std::vector<TileProgress>& progress);
    /// To be called when an ally's state or tiles may have changed.
    void look_again(Instant now, std::vector<Action>& actions);
    /// An ally's broker takes back a tile. False: it is not here.
    bool cancel(Instant now, const protocol::CancelTile& tile, std::vector<Action>& actions);
    /// Says that it takes nothing more, which allies must have said before any hands back a tile.
    void prepare_to_leave(Instant now, FinishReason reason, std::vector<Action>& actions);
    /// The broker has taken another session of this worker for a newer one.
    void greet_anew(Instant now, std::vector<Action>& actions);
    /// Says Goodbye, drops what is here, and is over; there is no Finished.
    void close(Instant now, std::vector<Action>& actions);
    /// Answers that its allies' brokers wait for as well; each is taken once.
    [[nodiscard]] std::vector<protocol::Message> take_answers_for_allies() {
        return std::exchange(answers_for_allies_, {});
    }

    [[nodiscard]] bool is_connected() const {
        return state_ == State::open || state_ == State::draining;
    }
    [[nodiscard]] bool is_over() const { return state_ == State::over; }
    /// The best that it has had so far.
    [[nodiscard]] Reception reception() const { return reception_; }
    [[nodiscard]] bool is_leaving() const {
        return state_ == State::draining || state_ == State::stranded;
    }
    [[nodiscard]] std::size_t tile_count() const { return tiles_.size(); }
    /// On the shelf, at that stage.
    [[nodiscard]] std::vector<ContentHash> scenes_at(SceneOnShelf::Stage stage) const;

private:
    /// greeting: no session, a hello is or will be under way. open. draining: open, but takes
    /// nothing more, and ends when nothing is left. stranded: draining without its broker, as an
    /// ally waits for its tiles. over: finished.
    enum class State : std::uint8_t { greeting, open, draining, stranded, over };

    struct Tile {
        protocol::RenderTile order;
        std::uint64_t rays = 0;
        bool started = false;
        bool holds_scene = false; ///< no: it waits for room on the shelf
    };
    using Tiles = std::map<Ticket, Tile>; // in order of arrival

    /// One step: its time and where its actions go.
    struct Turn {
        Instant now;
        std::vector<Action>& actions;
        void log(LogLevel level, std::string_view kind, std::string text) {
            actions.emplace_back(Log{level, kind, {}, std::move(text)});
        }
    };

    void on(Turn& turn, const Received& event);
    void on(Turn& turn, const Undecodable& event);
    void on(Turn& turn, const SceneCompiled& event);
    void on(Turn& turn, const SceneFailed& event);
    void on(Turn& turn, const TileFinished& event);
    void on(Turn& turn, const TileBroken& event);
    void on(Turn& turn, const CallerGone& event);
    void on(Turn& turn, const Tick& event);
    void on(Turn& turn, const Drain& event);
    void on(Turn& turn, const StopNow& event);

    void on_message(Turn& turn, const protocol::Welcome& message);
    void on_message(Turn& turn, const protocol::Refused& message);
    [[nodiscard]] bool heed_older_version(Turn& turn, const Received& event);
    void on_message(Turn& turn, const protocol::Dismissed& message);
    void on_message(Turn& turn, const protocol::Brokers& message);
    void on_message(Turn& turn, const protocol::Beat& message);
    void on_message(Turn& turn, const protocol::Chunk& message);
    void on_message(Turn& turn, const protocol::RenderTile& message);
    void on_message(Turn& turn, const protocol::CancelTile& message);
    template <class M>
    void on_message(Turn& turn, const M& message); // anything else

    void send(Turn& turn, protocol::Message message) {
        turn.actions.emplace_back(Send{std::move(message), spoken_});
    }
    void keep_time(Turn& turn);
    void hello(Turn& turn, protocol::Version spoken);
    void beat(Turn& turn);
    void begin_greeting(Turn& turn);
    void hang_up(Turn& turn, bool for_good);
    void begin_draining(Turn& turn, FinishReason reason);
    void leave_when_done(Turn& turn);
    void finish(Turn& turn, FinishReason reason);
    void settle(Turn& turn);

    void ask_chunk(Turn& turn, const ContentHash& hash, SceneOnShelf& scene);
    void ask_overdue_chunks(Turn& turn);
    void tidy_shelf(Turn& turn);
    void admit(Turn& turn, Tiles::iterator at);
    void admit_waiting(Turn& turn);

    [[nodiscard]] Tiles::iterator find_tile(JobId job, TileIndex tile, AttemptNumber attempt);
    /// What an ally has been given under the same name; null: nothing.
    [[nodiscard]] const protocol::RenderTile*
    find_at_allies(const protocol::RenderTile& order) const;
    [[nodiscard]] Ticket next_ticket() {
        return Ticket{shared_tickets_ ? ++*shared_tickets_ : ++own_tickets_};
    }
    void start_tile(Turn& turn, Ticket ticket, Tile& tile);
    Tiles::iterator forget_tile(Turn& turn, Tiles::iterator at);
    void drop_tiles(Turn& turn);
    void drop_what_no_ally_wants(Turn& turn);
    void cancel(Turn& turn, Tiles::iterator at);
    void answer(Turn& turn, const protocol::RenderTile& order, protocol::Message message);
    void list_tiles(std::vector<protocol::TileInFlight>& list) const;
    void fail_tile(Turn& turn, Tiles::iterator at, protocol::FailureCode code,
                   const std::string& reason);
    void fail_tiles_of(Turn& turn, const ContentHash& scene, protocol::FailureCode code,
                       const std::string& reason);
    static void note_oddity(Turn& turn, const std::string& what);

    [[nodiscard]] std::uint32_t credit() const { return credit_for(identity_.threads, limits_); }
    [[nodiscard]] bool has_connected_ally() const;
    /// Of its allies and itself.
    [[nodiscard]] std::size_t tiles_in_hand() const;
    [[nodiscard]] protocol::Term greatest_term() const;
    [[nodiscard]] Duration leader_silence(Instant now) const; ///< as WorkerBeat has it
    void hear_term(const protocol::Term& term);
    [[nodiscard]] Instant silence_deadline() const { return heard_ + heartbeat_ * liveness_; }
    [[nodiscard]] Instant chunk_deadline(const SceneOnShelf& scene) const {
        return scene.asked + heartbeat_ * limits_.chunk_patience_beats;
    }

    Identity identity_;
    Limits limits_;
    Rng rng_;
    State state_ = State::greeting;

    std::uint64_t incarnation_ = 0;                // of the last hello
    protocol::Version spoken_ = protocol::version; // likewise, and so of its session
    BrokerId broker_;                              // that spoke last
    std::optional<AttemptNumber> last_attempt_;    // of its RenderTiles
    protocol::Term term_;                          // the greatest heard of here
    Duration hello_pause_;
    Instant last_hello_{}, next_hello_{};
    std::uint32_t unanswered_hellos_ = 0;
    Reception reception_ = Reception::nobody;
    bool absence_said_ = false; // one line for each change between connected and not

    Duration heartbeat_{};
    std::uint32_t liveness_ = 1;
    Instant heard_{}, next_beat_{};
    std::optional<Instant> led_at_; // it has said last that it leads, unless it has said otherwise
    std::uint64_t unanswered_beats_ = 0;

    FinishReason leave_reason_ = FinishReason::drained; // while draining
    Instant leave_by_ = Instant::never();               // draining, with no tile left

    std::vector<const Session*> allies_;
    bool is_of_several_ = false; // its broker stands with others, or has
    std::vector<protocol::Message> answers_for_allies_;

    std::uint64_t own_tickets_ = 0;
    std::uint64_t* shared_tickets_ = nullptr; // in place of its own
    std::uint64_t tiles_received_ = 0;        // in this session
    Tiles tiles_;
    std::size_t waiting_count_ = 0; ///< of these, for room on the shelf
    SceneShelf shelf_;

    std::uint64_t rays_done_ = 0; // for the speed told in the next hello
    Duration render_time_{};
};

} // namespace fraja::worker
