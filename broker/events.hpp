// What happens to the broker's core, and what it wants done.
#pragma once

#include "broker/contents.hpp"
#include "broker/writes.hpp"
#include "common/base/instant.hpp"
#include "common/base/log_line.hpp"
#include "common/base/result.hpp"
#include "common/protocol/messages.hpp"
#include "common/protocol/roles.hpp"

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace fraja::broker {

/// A connection, as the ROUTER names it.
using PeerId = std::string;

/// A tile or a probe that another broker wants of this one: as in protocol::RenderTile.
struct Order {
    JobId id; ///< of the job that is made of it here: never used before
    std::uint32_t pass = 0;
    PixelRect rect;
    ContentHash scene;
    Blob scene_text; ///< of that hash
    protocol::PictureSettings settings;
    std::uint32_t probe_side = 0;
};

// ------------------------------------------------------------------------------------------ events

/// Null: there are no keys, and everybody may do all.
using Holder = std::shared_ptr<const protocol::KeyHolder>;

struct PeerSaid {
    PeerId peer;
    protocol::Message message;
    Holder holder = {};                            ///< whose key it came with, as it is now
    protocol::Version version = protocol::version; ///< that it was said in
};
/// From now on these keys are known.
struct RolesChanged {
    std::map<std::string, protocol::Roles> roles; ///< by key
};
/// Bytes came that are no message (malformed_frame), or one of another version (version_mismatch).
struct PeerSpokeRubbish {
    PeerId peer;
    Error error;
    protocol::Version version = protocol::version; ///< as far as bytes tell
};
/// A message could not be sent: the connection is gone, or its peer does not read.
struct PeerUnreachable {
    PeerId peer;
};
/// By a connection that was dialled.
struct BrokerSaid {
    std::string endpoint;
    protocol::Message message;
    protocol::Version version = protocol::version; ///< that it was said in
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
/// Answered by OrderFilled or OrderFailed, unless it is withdrawn.
struct Ordered {
    Order order;
};
struct OrderWithdrawn {
    JobId id;
};

using Event = std::variant<PeerSaid, PeerSpokeRubbish, PeerUnreachable, BrokerSaid, TopicSubscribed,
                           TopicUnsubscribed, Tick, Restored, Stored, StoreFails, StoreWorks,
                           SceneLoaded, Ordered, OrderWithdrawn, RolesChanged>;

// ----------------------------------------------------------------------------------------- actions

struct Send {
    PeerId peer;
    protocol::Message message;
    protocol::Version version = protocol::version; ///< that the peer speaks, and that knows it
};
/// Connect to another broker, as a client does, and stay so until HangUp.
struct Dial {
    std::string endpoint;
};
struct HangUp {
    std::string endpoint;
};
/// To a broker that was dialled; lost, where there is no connection at the moment.
struct Tell {
    std::string endpoint;
    protocol::Message message;
};
/// In the oldest version that is spoken: nobody knows who listens.
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
    std::uint64_t epoch = 0;                       ///< that they say to be of
    protocol::Version version = protocol::version; ///< as in Send
};
/// Answered by SceneLoaded.
struct LoadScene {
    JobId job;
    ContentHash scene;
    PeerId peer; ///< who wants it
};
/// The order's pixels, in parts that may overlap, or a probe's numbers.
struct OrderFilled {
    JobId id;
    std::vector<std::shared_ptr<const protocol::TileDone>> parts;
    std::vector<Blob> probe;
    protocol::Rays rays;
    Duration render_time{}; ///< summed over render threads
};
/// How far one is.
struct OrderProgress {
    JobId id;
    std::uint64_t rays = 0; ///< traced so far, as far as workers have told
};
struct OrderFailed {
    JobId id;
    protocol::FailureCode code{}; ///< whose fault it is
    std::string reason;
};
using Log = LogLine;

using Action = std::variant<Send, Dial, HangUp, Tell, Publish, Persist, SendStored, LoadScene,
                            OrderFilled, OrderFailed, Log>;

} // namespace fraja::broker
