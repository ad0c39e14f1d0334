// The store: the jobs, scenes and finished tiles that a broker finds again when it starts. What is
// in it is read by StoreReader; that nobody waits for the disk is StoreWriter's affair.
#pragma once

#include "broker/sqlite.hpp"
#include "broker/state_lock.hpp"
#include "broker/writes.hpp"
#include "common/base/bytes.hpp"
#include "common/base/ids.hpp"
#include "common/base/result.hpp"
#include "common/protocol/messages.hpp"

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <variant>
#include <vector>

namespace fraja::broker {

/// What has survived when a commit returns: `written` the end of this process, `synced` that of
/// the machine. Commits survive in their order: with one all before it.
enum class Durability : std::uint8_t { written, synced };

using WallClock = std::function<std::chrono::system_clock::time_point()>;

struct StoreOptions {
    std::uint32_t tombstones_max = 10'000; ///< the newest are kept
    std::uint64_t file_bytes_max = 0;      ///< 0: as the disk has
    WallClock wall_clock = std::chrono::system_clock::now;
};

// ------------------------------------------------------------------------------------------ store

/// The writing side. One thread at a time; errors are values, of code io but where it says so.
class Store {
public:
    /// Makes the directory (for its owner alone) and the file where there are none. Refuses, and
    /// leaves as it is: a directory that another broker is using, or that may not be written to; a
    /// file that is damaged; one of a newer version (version_mismatch); one that is no store
    /// (invalid_argument). Reads all of the file, to find damage.
    [[nodiscard]] static Result<Store> open(const std::filesystem::path& directory,
                                            StoreOptions options = {});

    /// All of it or, where there is an error, nothing. It then may be tried again.
    [[nodiscard]] Result<void> commit(std::span<const Write> writes, Durability durability);

    /// Jobs of which a ForgetJob waits for its turn go now, tombstones and all, so that there is
    /// room for what comes before it; but for scenes, which a job to come may need. Synced.
    [[nodiscard]] Result<void> make_room(std::span<const JobId> jobs);

    /// A number for this start of the broker, larger than all before, whatever the clock says: it
    /// is microseconds since 1970 where that is larger. On a full disk it cannot be kept, and the
    /// next one is larger only if the clock is.
    [[nodiscard]] Result<std::uint64_t> next_epoch();

    /// From now on the file does not grow beyond that; 0: it may. What it has already stays.
    [[nodiscard]] Result<void> limit_file(std::uint64_t bytes_max);

    /// The store's file, for a StoreReader.
    [[nodiscard]] std::filesystem::path file() const { return database_.file(); }

private:
    Store(StateLock lock, Database database, StoreOptions options);

    [[nodiscard]] Result<void> make_durable(Durability durability);
    /// Begins a transaction, in which `work` returns a Result<void>, and ends it either way.
    template <class Work>
    [[nodiscard]] Result<void> transact(Durability durability, Work work);
    [[nodiscard]] Result<void> put(const PutBlob& blob);
    [[nodiscard]] Result<void> put(const PutJob& job);
    [[nodiscard]] Result<void> put(const PutTile& tile);
    [[nodiscard]] Result<void> put(const PutPhase& phase);
    [[nodiscard]] Result<void> put(const PutDistrusted& distrusted);
    [[nodiscard]] Result<void> put(const PutTrusted& trusted);
    [[nodiscard]] Result<void> put(const PutPriority& priority);
    [[nodiscard]] Result<void> put(const PutNumber& number);
    [[nodiscard]] Result<void> put(const PutTerm& term);
    [[nodiscard]] Result<void> put(const ForgetJob& forget);
    [[nodiscard]] Result<void> drop(const JobId& job);
    [[nodiscard]] Result<void> bury(const JobId& job);
    [[nodiscard]] Result<void> put_pieces(std::int64_t blob, const std::vector<Blob>& pieces);
    [[nodiscard]] Result<void> drop_unused_blobs();
    [[nodiscard]] std::int64_t now() const; ///< ns since 1970

    StateLock lock_; // first to be taken, last to go
    StoreOptions options_;
    Database database_;
    Durability durability_ = Durability::synced; ///< as the database is set

    Statement begin_, commit_;
    Statement find_blob_, put_blob_, put_piece_, drop_pieces_, drop_blobs_;
    Statement put_job_, raise_number_, set_term_, set_phase_, set_priority_, set_number_, drop_job_;
    Statement tile_is_new_, put_pixels_, put_tile_, drop_pixels_, drop_tiles_;
    Statement put_distrusted_, put_trusted_, drop_pixels_of_tile_, drop_tile_, drop_distrusted_;
    Statement put_tombstone_, drop_tombstone_, drop_old_tombstones_;
};

} // namespace fraja::broker
