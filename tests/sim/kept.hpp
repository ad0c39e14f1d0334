// Kept: what broker/store has on its disk, in memory: the same values, with the same effects.
#pragma once

#include "broker/contents.hpp"
#include "broker/writes.hpp"
#include "common/base/bytes.hpp"
#include "common/base/ids.hpp"
#include "common/base/instant.hpp"
#include "common/protocol/messages.hpp"

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

namespace fraja::sim {

/// Times are of a wall clock, which may jump.
class Kept {
public:
    explicit Kept(std::size_t tombstones_max) : tombstones_max_(tombstones_max) {}

    void put(const broker::Write& write, Duration wall_now);

    /// As StoreReader reads it.
    [[nodiscard]] broker::Contents contents(Duration wall_now) const;
    [[nodiscard]] std::optional<Bytes> scene(const ContentHash& hash) const;
    /// All of that number: they may differ in size.
    [[nodiscard]] std::vector<std::shared_ptr<const protocol::TileDone>>
    tiles(JobId job, TileIndex tile) const;

    /// Of a start.
    std::uint64_t next_epoch(std::uint64_t at_least) {
        return epoch_ = std::max(epoch_ + 1, at_least);
    }

private:
    using TileKey = std::tuple<TileIndex, std::uint32_t, std::uint32_t>; // with its extent
    struct KeptJob {
        broker::StoredJob job; ///< without ages and tiles
        Duration submitted_at{};
        std::optional<Duration> over_at;
        std::map<TileKey, std::shared_ptr<const protocol::TileDone>> tiles;
    };
    void put(const broker::PutBlob& blob, Duration now);
    void put(const broker::PutJob& job, Duration now);
    void put(const broker::PutTile& tile, Duration now);
    void put(const broker::PutPhase& phase, Duration now);
    void put(const broker::PutDistrusted& distrusted, Duration now);
    void put(const broker::PutTrusted& trusted, Duration now);
    void put(const broker::PutPriority& priority, Duration now);
    void put(const broker::PutNumber& number, Duration now);
    void put(const broker::PutTerm& term, Duration now);
    void put(const broker::ForgetJob& forget, Duration now);

    std::size_t tombstones_max_;
    std::map<JobId, KeptJob> jobs_;
    std::map<ContentHash, Bytes> scenes_;
    std::deque<std::pair<JobId, Duration>> tombstones_;
    std::uint32_t last_number_ = 0;
    std::uint64_t epoch_ = 0, last_term_ = 0;
};

} // namespace fraja::sim
