// What happens to the broker's core, and what it wants done.
#pragma once

#include "broker/contents.hpp"
#include "broker/writes.hpp"
#include "common/base/instant.hpp"
#include "common/base/result.hpp"
#include "common/protocol/messages.hpp"

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <variant>
#include <vector>

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
/// What was kept by a broker before this one. Once, before all else.
struct Restored {
    Contents contents;
    std::map<ContentHash, Bytes> scenes; ///< of the jobs that are not over, as far as they are kept
};
/// Everything that was persisted up to there is kept.
struct Stored {
    std::uint64_t sequence = 0;
};
/// What is persisted cannot be kept at the moment; it is tried again.
struct StoreFails {
    std::string reason;
};
struct StoreWorks {};
/// Answers LoadScene.
struct SceneLoaded {
    JobId job;
    PeerId peer;
    std::optional<Bytes> scene; ///< nothing: it is not kept
};

using Event =
    std::variant<PeerSaid, PeerSpokeRubbish, PeerUnreachable, TopicSubscribed, TopicUnsubscribed,
                 Tick, Restored, Stored, StoreFails, StoreWorks, SceneLoaded>;

// ----------------------------------------------------------------------------------------- actions

struct Send {
    PeerId peer;
    protocol::Message message;
};
struct Publish {
    std::string topic;
    protocol::Message message;
};
/// Into the store, in this order. Answered by Stored, in good time.
struct Persist {
    std::uint64_t sequence = 0; ///< from 1
    Write write;
};
/// Finished tiles of a job, from the store.
struct SendStored {
    PeerId peer;
    JobId job;
    std::vector<TileIndex> tiles;
};
/// Answered by SceneLoaded.
struct LoadScene {
    JobId job;
    ContentHash scene;
    PeerId peer; ///< who wants it
};
enum class LogLevel : std::uint8_t { debug, info, warning, error };
struct Log {
    LogLevel level;
    std::string text;
};

using Action = std::variant<Send, Publish, Persist, SendStored, LoadScene, Log>;

} // namespace fraja::broker
