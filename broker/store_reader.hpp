// The store's reading side: all that is kept, when a broker starts, and later the pixels and scenes
// that are asked for.
#pragma once

#include "broker/contents.hpp"
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

/// A connection of its own: a thread may read while another writes, each with one of these. It sees
/// what is committed when a call begins. The store must be open; errors are as the store's.
class StoreReader {
public:
    [[nodiscard]] static Result<StoreReader>
    open(const Store& store, WallClock wall_clock = std::chrono::system_clock::now);

    [[nodiscard]] Result<Contents> read();

    /// The tiles with their pixels, cut every protocol::chunk_bytes, in the order in which they are
    /// asked for; those that are not there are left out. Of one number there may be several.
    [[nodiscard]] Result<std::vector<protocol::TileDone>> tiles(const JobId& job,
                                                                std::span<const TileIndex> which);
    /// Nothing where it is not kept.
    [[nodiscard]] Result<std::optional<Bytes>> blob(const ContentHash& hash);

private:
    StoreReader(Database database, WallClock wall_clock);

    [[nodiscard]] Result<Contents> read_all();
    [[nodiscard]] Result<void> read_jobs(Contents& contents);
    [[nodiscard]] Result<void> read_tiles(Contents& contents);
    [[nodiscard]] Result<void> read_distrusted(Contents& contents);
    [[nodiscard]] Result<void> read_blobs(Contents& contents);
    [[nodiscard]] Result<void> read_tombstones(Contents& contents);
    [[nodiscard]] Result<void> read_farm(Contents& contents);
    [[nodiscard]] Result<void> append_tiles(const JobId& job, TileIndex which,
                                            std::vector<protocol::TileDone>& found);
    [[nodiscard]] Result<std::optional<Bytes>> read_blob(const ContentHash& hash);
    [[nodiscard]] Duration since(std::int64_t at) const;

    Database database_;
    WallClock wall_clock_;
    Statement begin_, commit_;
    Statement jobs_, all_tiles_, distrusted_, blobs_, tombstones_, farm_;
    Statement tile_, blob_size_, pieces_;
};

} // namespace fraja::broker
