// What happens to the broker's core, and what it wants done.
#pragma once

#include "common/base/result.hpp"
#include "common/protocol/messages.hpp"

#include <cstdint>
#include <string>
#include <variant>

namespace fraja::broker {

/// A connection, as the ROUTER names it.
using PeerId = std::string;

// ------------------------------------------------------------------------------------------ events

struct PeerSaid {
    PeerId peer;
    protocol::Message message;
};
/// Bytes came that are no message (malformed_frame), or one of another version (version_mismatch).
struct PeerSpokeRubbish {
    PeerId peer;
    Error error;
};
/// A message could not be sent: the connection is gone, or its peer does not read.
struct PeerUnreachable {
    PeerId peer;
};
struct TopicSubscribed {
    std::string topic;
};
struct TopicUnsubscribed { ///< by the last of its subscribers
    std::string topic;
};
struct Tick {};

using Event = std::variant<PeerSaid, PeerSpokeRubbish, PeerUnreachable, TopicSubscribed,
                           TopicUnsubscribed, Tick>;

// ----------------------------------------------------------------------------------------- actions

struct Send {
    PeerId peer;
    protocol::Message message;
};
struct Publish {
    std::string topic;
    protocol::Message message;
};
enum class LogLevel : std::uint8_t { debug, info, warning, error };
struct Log {
    LogLevel level;
    std::string text;
};

using Action = std::variant<Send, Publish, Log>;

} // namespace fraja::broker
