// What the client's cores have in common: the events they take in, the actions they ask for, and
// the news among those that a program shows to its user.
#pragma once

#include "client/exit_code.hpp"
#include "common/base/instant.hpp"
#include "common/base/result.hpp"
#include "common/protocol/messages.hpp"

#include <string>
#include <variant>
#include <vector>

namespace fraja::client {

// ----------------------------------------------------------------------------------------- events

/// By the session's connection.
struct FromBroker {
    protocol::Message message;
    protocol::Version version = protocol::version; ///< that it was said in
};
/// By the subscription.
struct FromStream {
    protocol::Message message;
};
/// Frames on the session's connection that are no message of a version that is spoken.
struct Undecodable {
    Error error;
};
/// A Send could not be handed over: there is no connection at the moment.
struct NotSent {};
/// Who listens there does not let us in: keys that do not fit.
struct TurnedAway {
    std::string reason;
};
/// Nothing is waiting to be read. Timers run at ticks alone, so that a program that was busy for a
/// while reads what came meanwhile before it calls its peer silent.
struct Tick {};
/// What is known of a source (common/discovery) from now on: a Look has asked for it.
struct BrokersFound {
    std::string source;
    std::vector<std::string> endpoints; ///< in the order in which they are to be tried
    std::string trouble;                ///< why there are none, for people; may be empty
};

using Event =
    std::variant<FromBroker, FromStream, Undecodable, NotSent, TurnedAway, Tick, BrokersFound>;

// ------------------------------------------------------------------------------------------- news

/// The broker has acknowledged the submission.
struct Accepted {
    protocol::JobState state;
};
/// A tile's pixels: checked against the job, and new.
struct TileArrived {
    protocol::TileDone tile;
    std::uint32_t cell_count = 0; ///< of its job
};
/// These pixels do not count any more: they come again.
struct TilesWithdrawn {
    std::vector<PixelRect> rects;
    std::string worker_name; ///< that answers wrong ones; empty: a broker that knew them has died
};
/// The job as the broker sees it now. Older states that come late are not shown.
struct StateChanged {
    protocol::JobState state;
};
struct FarmChanged {
    protocol::FarmState farm;
};
/// The broker is reached, or was lost and is being looked for.
struct ConnectionChanged {
    bool connected = false;
    std::string broker; ///< the endpoint
    std::string stream; ///< where that says its stream is; empty where it is lost
    /// It is known by its own announcement alone, and has shown no key: it may be anybody.
    bool is_unproven = false;
};
/// The last word of a core.
struct Finished {
    Outcome outcome;
};

using News = std::variant<Accepted, TileArrived, TilesWithdrawn, StateChanged, FarmChanged,
                          ConnectionChanged, Finished>;

// ---------------------------------------------------------------------------------------- actions

/// Open a session's connection, instead of the one there was.
struct Connect {
    std::string broker;
};
/// What is sent from now on, by whatever connection, is of that version. Before: of the newest.
struct Speak {
    protocol::Version version = protocol::version;
};
/// There is no connection any more: find out which brokers that source has. It is told by
/// BrokersFound, also if nothing has changed, and whenever something does.
struct Look {
    std::string source;
};
/// A broker is here: nobody need be found.
struct StopLooking {};
/// Open the stream, instead of the one there was; its subscriptions are forgotten.
struct OpenStream {
    std::string told; ///< Welcome's words: an endpoint as the broker sees it
};
struct Subscribe {
    std::string topic;
};
struct Unsubscribe {
    std::string topic;
};
struct Send {
    protocol::Message message;
};

using Action =
    std::variant<Connect, Speak, Look, StopLooking, OpenStream, Subscribe, Unsubscribe, Send, News>;

/// Decides; has no socket, clock, thread or global. Same history, same actions.
class Core {
public:
    virtual ~Core() = default;
    /// Opens the conversation. Call once, first.
    virtual void start(Instant now, std::vector<Action>& actions) = 0;
    /// Takes in one event and appends what must now be done. After Finished: nothing.
    virtual void step(Instant now, const Event& event, std::vector<Action>& actions) = 0;
    /// When a Tick is due even if nothing arrives.
    [[nodiscard]] virtual Instant next_deadline() const = 0;
};

} // namespace fraja::client
