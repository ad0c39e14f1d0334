// What is in the store when a broker starts, but for pixels and scenes.
#pragma once

#include "common/base/ids.hpp"
#include "common/base/instant.hpp"
#include "common/base/pixel_rect.hpp"
#include "common/protocol/messages.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace fraja::broker {

/// A finished tile without its pixels.
struct StoredTile {
    TileIndex tile{};
    std::uint32_t frame = 0, pass = 0;
    PixelRect rect;
    protocol::Rays rays;
    Duration elapsed{};
    WorkerId worker{}; ///< zero: one of an earlier version tells nothing of that
    std::string worker_name{};
    ContentHash pixels{};
    friend bool operator==(const StoredTile&, const StoredTile&) = default;
};

struct StoredJob {
    protocol::SubmitJob submission; ///< with the priority that it has now
    std::uint32_t number = 0, passes = 1;
    protocol::Revision revision{};
    protocol::JobPhase phase{};
    std::string reason;
    Duration elapsed{};               ///< as the phase came with
    Duration age{};                   ///< since it was submitted; 0 where clocks say less
    std::optional<Duration> over_for; ///< since it ended, if it has; 0 where clocks say less
    std::vector<StoredTile> tiles;    ///< by index
    protocol::CheckCounts checks{};   ///< as the phase came with
    std::vector<protocol::Distrusted> distrusted{};
};

struct StoredBlob {
    ContentHash hash;
    std::uint64_t size_bytes = 0;
    friend bool operator==(const StoredBlob&, const StoredBlob&) = default;
};

/// A job that was forgotten.
struct Tombstone {
    JobId job;
    Duration age{}; ///< since then; 0 where clocks say less
};

struct Contents {
    std::vector<StoredJob> jobs;       ///< by number
    std::vector<StoredBlob> blobs;     ///< by hash
    std::vector<Tombstone> tombstones; ///< the oldest first
    std::uint32_t last_number = 0;     ///< of all jobs there ever were; 0: none
    std::uint64_t last_term = 0;       ///< of several brokers, that was heard of; 0: none
};

} // namespace fraja::broker
