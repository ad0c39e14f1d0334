// What is written to the store, as values.
//
// Each of them may come twice: the second changes nothing. What is about a job that is not there
// does nothing.
#pragma once

#include "common/base/bytes.hpp"
#include "common/base/ids.hpp"
#include "common/base/instant.hpp"
#include "common/base/pixel_rect.hpp"
#include "common/protocol/messages.hpp"

#include <cstdint>
#include <memory>
#include <string>
#include <variant>
#include <vector>

namespace fraja::broker {

/// A scene, whole. It and the PutJob that needs it follow one another, in either order: with a
/// ForgetJob between them it may be gone, since that takes every scene that no job needs.
struct PutBlob {
    ContentHash hash;
    std::vector<Blob> pieces; ///< of any size; together they are the scene
};
/// A job in its first phase, submitted now. It takes a tombstone of its own away.
struct PutJob {
    protocol::SubmitJob submission;
    std::uint32_t number = 0;
    std::uint32_t passes = 1;
    protocol::Revision revision{};
    protocol::JobPhase phase{}; ///< of a copy that has no scene: over, or paused
};
struct PutTile {
    std::shared_ptr<const protocol::TileDone> tile; ///< not null
};
/// The first phase of a job that is_over says when it ended: now.
struct PutPhase {
    JobId job;
    protocol::JobPhase phase{};
    std::string reason;
    Duration elapsed{};
    protocol::Revision revision{};
    protocol::CheckCounts checks{};
};
/// These tiles of the job go. That worker has drawn them, and is named from now on; its id is zero
/// where they go without that.
struct PutDistrusted {
    JobId job;
    protocol::Distrusted worker;
    struct Tile {
        TileIndex tile{};
        Extent size;
    };
    std::vector<Tile> tiles;
    protocol::Revision revision{};
};
/// That worker is named no more.
struct PutTrusted {
    JobId job;
    WorkerId worker;
};
struct PutPriority {
    JobId job;
    std::int32_t priority = 0;
    protocol::Revision revision{};
};
/// Another one than it was put with: two brokers had given the same.
struct PutNumber {
    JobId job;
    std::uint32_t number = 0;
    protocol::Revision revision{};
};
/// Of brokers that stand for each other: the next start's epoch is later than that.
struct PutTerm {
    std::uint64_t counter = 0;
};
/// The job goes, with its tiles and all scenes that no job needs now. A tombstone stays.
struct ForgetJob {
    JobId job;
    bool may_come_back = false; ///< no tombstone stays: it was a copy of which not all had come
};

using Write = std::variant<PutBlob, PutJob, PutTile, PutPhase, PutDistrusted, PutTrusted,
                           PutPriority, PutNumber, PutTerm, ForgetJob>;

/// Of these a peer is told, or others depend on them: they are on the disk before that.
[[nodiscard]] inline bool wants_sync(const Write& write) {
    return std::holds_alternative<PutJob>(write) || std::holds_alternative<PutPhase>(write) ||
           std::holds_alternative<PutDistrusted>(write) || std::holds_alternative<PutTerm>(write) ||
           std::holds_alternative<ForgetJob>(write);
}

/// What a write takes in memory, about.
[[nodiscard]] std::uint64_t size_bytes(const Write& write);

} // namespace fraja::broker
