// The store's reading side: all that is kept, when a broker starts, and later the pixels and scenes
// that are asked for.
#pragma once

#include "broker/sqlite.hpp"
#include "broker/store.hpp"
#include "common/base/bytes.hpp"
#include "common/base/ids.hpp"
#include "common/base/instant.hpp"
#include "common/base/pixel_rect.hpp"
#include "common/base/result.hpp"
#include "common/protocol/messages.hpp"

#include <cstdint>
#include <optional>
#include <span>
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
    friend bool operator==(const StoredTile&, const StoredTile&) = default;
};

struct StoredJob {
    protocol::SubmitJob submission; ///< with the priority that it has now
    std::uint32_t number = 0, passes = 1;
    protocol::JobPhase phase{};
    std::string reason;
    Duration elapsed{};               ///< as the phase came with
    Duration age{};                   ///< since it was submitted; 0 where clocks say less
    std::optional<Duration> over_for; ///< since it ended, if it has; 0 where clocks say less
    std::vector<StoredTile> tiles;    ///< by index
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
};

/// A connection of its own: a thread may read while another writes, each with one of these. It sees
/// what is committed when a call begins. The store must be open; errors are as the store's.
class StoreReader {
public:
    [[nodiscard]] static Result<StoreReader>
    open(const Store& store, WallClock wall_clock = std::chrono::system_clock::now);

    [[nodiscard]] Result<Contents> read();

    /// The tiles with their pixels, cut every protocol::chunk_bytes, in the order in which they are
    /// asked for; those that are not there are left out.
    [[nodiscard]] Result<std::vector<protocol::TileDone>> tiles(const JobId& job,
                                                                std::span<const TileIndex> which);
    /// Nothing where it is not kept.
    [[nodiscard]] Result<std::optional<Bytes>> blob(const ContentHash& hash);

private:
    StoreReader(Database database, WallClock wall_clock);

    [[nodiscard]] Result<Contents> read_all();
    [[nodiscard]] Result<void> read_jobs(Contents& contents);
    [[nodiscard]] Result<void> read_tiles(Contents& contents);
    [[nodiscard]] Result<void> read_blobs(Contents& contents);
    [[nodiscard]] Result<void> read_tombstones(Contents& contents);
    [[nodiscard]] Result<void> read_last_number(Contents& contents);
    [[nodiscard]] Result<std::optional<protocol::TileDone>> tile(const JobId& job, TileIndex which);
    [[nodiscard]] Result<std::optional<Bytes>> read_blob(const ContentHash& hash);
    [[nodiscard]] Duration since(std::int64_t at) const;

    Database database_;
    WallClock wall_clock_;
    Statement begin_, commit_;
    Statement jobs_, all_tiles_, blobs_, tombstones_, last_number_;
    Statement tile_, blob_size_, pieces_;
};

} // namespace fraja::broker
