// Crew: one worker's sessions, with the brokers that it was told to serve and with those that these
// tell of. Brokers that stand for each other see one worker: each hears every answer, and a tile
// goes on when the one that gave it is gone. It moves nothing, as a session does not.
#pragma once

#include "common/base/ids.hpp"
#include "common/base/instant.hpp"
#include "common/protocol/messages.hpp"
#include "worker/session.hpp"

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

namespace fraja::worker {

// ------------------------------------------------------------------------------------------ events

/// Of a session's broker or render threads: all but Tick, Drain and StopNow.
struct SessionEvent {
    SessionIndex session{};
    Event event;
};
/// The endpoint of an Open cannot be connected to.
struct NotOpened {
    SessionIndex session{};
};
/// What is known of a source (common/discovery) from now on.
struct BrokersFound {
    std::string source;
    std::vector<std::string> endpoints; ///< as sockets connect to them
};
struct SessionProgress {
    SessionIndex session{};
    std::vector<TileProgress> tiles;
};
/// As Tick: so far are the running tiles of all sessions.
struct CrewTick {
    std::vector<SessionProgress> progress;
};

using CrewEvent = std::variant<SessionEvent, NotOpened, BrokersFound, CrewTick, Drain, StopNow>;

// ----------------------------------------------------------------------------------------- actions

/// Connect to a broker that was told of, or found: from now on there is a session of that number,
/// which a CrewTick that is due at once has say hello.
struct Open {
    std::string endpoint;
};
/// The session is over: let what was sent leave, and hang up. Its number may be opened anew.
struct Close {};

using CrewDeed =
    std::variant<Send, CompileScene, StartTile, StopTile, ForgetScene, HangUp, Log, Open, Close>;

struct CrewAction {
    SessionIndex session{};
    CrewDeed deed;
};

// -------------------------------------------------------------------------------------------- crew

struct CrewOptions {
    Identity identity; ///< of all sessions
    /// Of the brokers that it shall serve, in the order of their sessions; none where all are to be
    /// found. Of a worker that is called: one, which nobody reads.
    std::vector<std::string> endpoints;
    /// Whether brokers are looked for: then it is never over because there are none.
    bool is_looking = false;
    SessionIndex first{}; ///< its sessions are numbered from this one on
    Limits limits;
};

/// Brokers that are served because they were found, at a time.
inline constexpr std::size_t brokers_found_max = 16;

/// So many numbers a crew takes for its sessions, at most.
[[nodiscard]] std::uint32_t crew_sessions_max(std::size_t endpoint_count, bool is_called,
                                              bool is_looking);

class Crew {
public:
    /// The shell has the connections to the endpoints already, or makes them.
    explicit Crew(CrewOptions options);
    Crew(const Crew&) = delete; // sessions know of each other
    Crew& operator=(const Crew&) = delete;

    /// Takes in one event and appends what must now be done. Same history, same actions. What comes
    /// for a session that is over is dropped; but what its render threads end is heard.
    void step(Instant now, const CrewEvent& event, std::vector<CrewAction>& actions);
    /// When a CrewTick is due; it may be at once. What has arrived for any session is heard before.
    [[nodiscard]] Instant next_deadline() const;
    /// Nothing is left to do; why the last session ended.
    [[nodiscard]] std::optional<FinishReason> finished() const { return finished_; }

    /// Those that are not over.
    [[nodiscard]] std::vector<SessionIndex> sessions() const;
    [[nodiscard]] bool is_connected(SessionIndex session) const;
    /// The best that any broker has given it.
    [[nodiscard]] Reception reception() const { return reception_; }
    /// With no session: brokers are to be looked for.
    [[nodiscard]] bool is_alone() const;

private:
    struct Slot {
        std::unique_ptr<Session> session; // null: over
        std::string endpoint;
        bool is_given = false;              // by the options, and not told of
        bool is_found = false;              // by a source: neither
        std::size_t teller = 0;             // otherwise: the slot whose broker told of it
        BrokerId broker;                    // that welcomed it last, or that was told of
        std::vector<protocol::Member> list; // as its broker said last
        std::vector<BrokerId> circle;       // who was ever in it, the newest last
        std::set<ContentHash> unwanted;     // that are still being compiled
    };
    struct Turn {
        Instant now;
        std::vector<CrewAction>& actions;
    };

    void on(Turn& turn, const SessionEvent& event);
    void on(Turn& turn, const NotOpened& event);
    void on(Turn& turn, const BrokersFound& event);
    void on(Turn& turn, const CrewTick& event);
    void on(Turn& turn, const Drain& event);
    void on(Turn& turn, const StopNow& event);

    void before(std::size_t slot, const protocol::Message& message);
    void after(Turn& turn, std::size_t slot, const protocol::Message& message);
    void note_list(Slot& slot, const BrokerId& broker, const std::vector<protocol::Member>& list);
    void heed_lists(Turn& turn, std::size_t teller);
    void look_for_alias(Turn& turn, std::size_t slot);
    template <class F>
    void with_session(Turn& turn, std::size_t slot, F deed);
    void settle(Turn& turn);
    void end_if_nobody_is_left(Turn& turn);

    void open(Turn& turn, std::size_t teller, const protocol::Member& member);
    void open(Turn& turn, const std::string& endpoint, const std::string& source);
    Slot& begin_session(Turn& turn, std::size_t slot, const std::string& endpoint);
    void let_go_of_vanished(Turn& turn);
    void close(Turn& turn, std::size_t slot, const std::string& why);
    void retire(Turn& turn, std::size_t slot);
    void shun(const Slot& slot);
    void log(Turn& turn, std::size_t slot, std::string_view kind, std::string text);
    void regroup();

    [[nodiscard]] std::size_t slot_of(SessionIndex session) const;
    [[nodiscard]] SessionIndex index_of(std::size_t slot) const;
    [[nodiscard]] bool is_connected(const Slot& slot) const {
        return slot.session && slot.session->is_connected();
    }
    [[nodiscard]] static bool are_allies(const Slot& a, const Slot& b);
    [[nodiscard]] bool is_served(const protocol::Member& member) const;
    [[nodiscard]] bool is_omitted(std::size_t slot) const;
    [[nodiscard]] bool is_found(const std::string& endpoint) const;
    [[nodiscard]] std::optional<std::size_t> free_slot() const;

    const Identity identity_;
    const Limits limits_;
    const SessionIndex first_;
    std::uint64_t last_ticket_ = 0;
    std::uint64_t last_incarnation_ = 0; // of sessions that are over
    std::vector<Slot> slots_;            // as many as were ever in use at once
    const std::size_t slots_max_;
    std::map<std::string, BrokerId> shunned_; // endpoints, and who is not to be served there
    const bool is_looking_;
    std::map<std::string, std::vector<std::string>> found_; // by source
    Instant shunned_until_{}; // of a crew that looks for brokers, unless it has one
    bool leaving_ = false;
    FinishReason reason_{};
    Reception reception_ = Reception::nobody;
    std::optional<FinishReason> finished_;
    std::vector<Action> buffer_;
};

} // namespace fraja::worker
