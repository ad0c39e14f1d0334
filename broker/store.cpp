#include "broker/store.hpp"

#include "broker/store_schema.hpp"
#include "common/base/assert.hpp"
#include "common/protocol/codec.hpp"
#include "common/protocol/content_hash.hpp"
#include "common/protocol/limits.hpp"

#include <algorithm>
#include <utility>

namespace fraja::broker {
namespace {

constexpr std::uint64_t write_overhead_bytes = 512; // of what has no pixels, and of those that have

std::uint64_t payload_bytes(const PutBlob& blob) {
    return byte_count(blob.pieces);
}
std::uint64_t payload_bytes(const PutTile& tile) {
    return byte_count(tile.tile->blobs);
}
std::uint64_t payload_bytes(const PutDistrusted& put) {
    return put.tiles.size() * sizeof(PutDistrusted::Tile);
}
std::uint64_t payload_bytes(const auto&) {
    return 0;
}

/// Tiles of one number may differ in size: the whole, and its first part.
std::int64_t extent_of(const Extent& size) {
    return static_cast<std::int64_t>(std::uint64_t{size.width} << 32 | size.height);
}

/// SQLite has no larger numbers.
std::int64_t counter_of(const protocol::Revision& revision) {
    return static_cast<std::int64_t>(std::min<std::uint64_t>(revision.counter, INT64_MAX));
}

} // namespace

std::uint64_t size_bytes(const Write& write) {
    return write_overhead_bytes + std::visit([](const auto& w) { return payload_bytes(w); }, write);
}

Store::Store(StateLock lock, Database database, StoreOptions options)
    : lock_(std::move(lock)), options_(std::move(options)), database_(std::move(database)),
      begin_(database_, "BEGIN IMMEDIATE"), commit_(database_, "COMMIT"),
      find_blob_(database_, "SELECT 1 FROM blobs WHERE hash = ?1"),
      put_blob_(database_, "INSERT INTO blobs (hash, size) VALUES (?1, ?2)"),
      put_piece_(database_, "INSERT INTO pieces VALUES (?1, ?2, ?3)"),
      drop_pieces_(database_, "DELETE FROM pieces WHERE blob IN (SELECT id FROM blobs "
                              "WHERE hash NOT IN (SELECT scene FROM jobs))"),
      drop_blobs_(database_, "DELETE FROM blobs WHERE hash NOT IN (SELECT scene FROM jobs)"),
      put_job_(
          database_,
          "INSERT INTO jobs VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, '', 0, ?8, NULL, ?9, ?10, 0, 0) "
          "ON CONFLICT DO NOTHING"),
      raise_number_(database_, "UPDATE farm SET last_number = max(last_number, ?1)"),
      set_term_(database_, "UPDATE farm SET epoch = max(epoch, ?1), term = max(term, ?1)"),
      set_phase_(database_, "UPDATE jobs SET phase = ?2, reason = ?3, elapsed = ?4, "
                            "over_at = CASE WHEN ?5 THEN coalesce(over_at, ?6) END, "
                            "revision = ?7, revised_by = ?8, agreed = ?9, unchecked = ?10 "
                            "WHERE job = ?1"),
      set_priority_(database_, "UPDATE jobs SET priority = ?2, revision = ?3, revised_by = ?4 "
                               "WHERE job = ?1"),
      set_number_(database_, "UPDATE jobs SET number = ?2, revision = ?3, revised_by = ?4 "
                             "WHERE job = ?1"),
      drop_job_(database_, "DELETE FROM jobs WHERE job = ?1"),
      tile_is_new_(database_, "SELECT 1 FROM jobs WHERE job = ?1 AND NOT EXISTS "
                              "(SELECT 1 FROM tiles WHERE job = ?1 AND tile = ?2 AND extent = ?3)"),
      put_pixels_(database_, "INSERT INTO pixels (bytes) VALUES (?1)"),
      put_tile_(database_, "INSERT INTO tiles VALUES (?1, ?2, ?3, ?4, ?5, ?6)"),
      drop_pixels_(database_,
                   "DELETE FROM pixels WHERE id IN (SELECT pixels FROM tiles WHERE job = ?1)"),
      drop_tiles_(database_, "DELETE FROM tiles WHERE job = ?1"),
      put_distrusted_(database_, "INSERT INTO distrusted SELECT ?1, ?2, ?3, ?4 WHERE EXISTS "
                                 "(SELECT 1 FROM jobs WHERE job = ?1) ON CONFLICT DO NOTHING"),
      put_trusted_(database_, "DELETE FROM distrusted WHERE job = ?1 AND worker = ?2"),
      drop_pixels_of_tile_(database_, "DELETE FROM pixels WHERE id IN (SELECT pixels FROM tiles "
                                      "WHERE job = ?1 AND tile = ?2 AND extent = ?3)"),
      drop_tile_(database_, "DELETE FROM tiles WHERE job = ?1 AND tile = ?2 AND extent = ?3"),
      drop_distrusted_(database_, "DELETE FROM distrusted WHERE job = ?1"),
      put_tombstone_(database_, "INSERT INTO tombstones (job, forgotten_at) VALUES (?1, ?2) "
                                "ON CONFLICT DO NOTHING"),
      drop_tombstone_(database_, "DELETE FROM tombstones WHERE job = ?1"),
      drop_old_tombstones_(database_, "DELETE FROM tombstones WHERE id <= "
                                      "(SELECT id FROM tombstones ORDER BY id DESC "
                                      "LIMIT 1 OFFSET ?1)") {}

Result<Store> Store::open(const std::filesystem::path& directory, StoreOptions options) {
    auto lock = StateLock::take(directory);
    if (!lock)
        return lock.error();
    auto database = open_store_file(directory / store_file_name);
    if (!database)
        return database.error();
    Store store(std::move(*lock), std::move(*database), std::move(options));
    if (const auto set = store.limit_file(store.options_.file_bytes_max); !set)
        return set.error();
    if (const auto set = store.database_.execute("PRAGMA synchronous = FULL"); !set)
        return set.error();
    return store;
}

Result<void> Store::limit_file(std::uint64_t bytes_max) {
    constexpr std::uint64_t pages_max = 0xfffffffe; // SQLite's own limit
    const auto page_bytes = database_.integer("PRAGMA page_size");
    if (!page_bytes)
        return page_bytes.error();
    const std::uint64_t pages = bytes_max / static_cast<std::uint64_t>(*page_bytes);
    const std::uint64_t wanted =
        bytes_max == 0 ? pages_max : std::clamp<std::uint64_t>(pages, 1, pages_max);
    const auto set = database_.integer("PRAGMA max_page_count = " + std::to_string(wanted));
    return set ? Result<void>() : Result<void>(set.error());
}

Result<std::uint64_t> Store::next_epoch() {
    const auto now_us = std::to_string(now() / 1000);
    const std::string next = "max(epoch + 1, " + now_us + ")";
    auto epoch = database_.integer("UPDATE farm SET epoch = " + next + " RETURNING epoch");
    if (!epoch)
        epoch = database_.integer("SELECT " + next + " FROM farm");
    if (!epoch)
        return epoch.error();
    return static_cast<std::uint64_t>(*epoch);
}

Result<void> Store::make_durable(Durability durability) {
    if (durability == durability_)
        return {};
    // NORMAL writes to the log and leaves it to the system when that reaches the disk; FULL waits
    // for it, with all that is in the log.
    const auto set =
        database_.execute(durability == Durability::synced ? "PRAGMA synchronous = FULL"
                                                           : "PRAGMA synchronous = NORMAL");
    if (set)
        durability_ = durability;
    return set;
}

template <class Work>
Result<void> Store::transact(Durability durability, Work work) {
    if (const auto set = make_durable(durability); !set)
        return set;
    auto done = begin_.run();
    if (done)
        done = work();
    if (done)
        done = commit_.run();
    if (!done && database_.in_transaction()) // some errors have rolled it back already
        if (const auto back = database_.execute("ROLLBACK"); !back)
            return back;
    return done;
}

Result<void> Store::commit(std::span<const Write> writes, Durability durability) {
    return transact(durability, [&]() -> Result<void> {
        for (const Write& write : writes)
            if (const auto done = std::visit([&](const auto& w) { return put(w); }, write); !done)
                return done;
        return {};
    });
}

Result<void> Store::make_room(std::span<const JobId> jobs) {
    return transact(Durability::synced, [&]() -> Result<void> {
        for (const JobId& job : jobs)
            if (const auto done = bury(job); !done)
                return done;
        return {};
    });
}

// ----------------------------------------------------------------------------------------- writes

Result<void> Store::put(const PutBlob& blob) {
    {
        Rows rows = find_blob_.query(key_of(blob.hash));
        const auto known = rows.next();
        if (!known)
            return known.error();
        if (*known)
            return {};
    }
    const auto size = static_cast<std::int64_t>(byte_count(blob.pieces));
    if (const auto done = put_blob_.run(key_of(blob.hash), size); !done)
        return done;
    return put_pieces(database_.last_row_id(), blob.pieces);
}

Result<void> Store::put_pieces(std::int64_t blob, const std::vector<Blob>& pieces) {
    std::int64_t count = 0;
    for (const Blob& piece : pieces)
        for (std::span<const std::byte> rest(piece); !rest.empty(); ++count) {
            const auto bytes = rest.first(std::min(rest.size(), protocol::chunk_bytes));
            if (const auto done = put_piece_.run(blob, count, bytes); !done)
                return done;
            rest = rest.subspan(bytes.size());
        }
    return {};
}

Result<void> Store::put(const PutJob& job) {
    const protocol::SubmitJob& submission = job.submission;
    const Bytes body = protocol::encode(submission).body;
    const auto phase = static_cast<std::int64_t>(job.phase);
    if (const auto done = put_job_.run(key_of(submission.job), job.number, job.passes,
                                       std::span<const std::byte>(body), key_of(submission.scene),
                                       submission.priority, phase, now(), counter_of(job.revision),
                                       key_of(job.revision.broker));
        !done)
        return done;
    if (const auto done = drop_tombstone_.run(key_of(submission.job)); !done)
        return done;
    return raise_number_.run(job.number);
}

Result<void> Store::put(const PutTile& put) {
    FRAJA_ASSERT(put.tile);
    const protocol::TileDone& tile = *put.tile;
    const auto index = static_cast<std::int64_t>(tile.tile);
    const auto extent = extent_of({tile.rect.width, tile.rect.height});
    {
        Rows rows = tile_is_new_.query(key_of(tile.job), index, extent);
        const auto is_new = rows.next();
        if (!is_new)
            return is_new.error();
        if (!*is_new)
            return {};
    }
    const Blob pixels = joined(tile.blobs);
    if (const auto done = put_pixels_.run(pixels); !done)
        return done;
    const Bytes body = protocol::encode(tile).body;
    return put_tile_.run(key_of(tile.job), index, extent, std::span<const std::byte>(body),
                         database_.last_row_id(), key_of(protocol::content_hash(pixels)));
}

Result<void> Store::put(const PutPhase& put) {
    return set_phase_.run(key_of(put.job), static_cast<std::int64_t>(put.phase),
                          std::string_view(put.reason), put.elapsed.count(),
                          std::int64_t{protocol::is_over(put.phase)}, now(),
                          counter_of(put.revision), key_of(put.revision.broker), put.checks.agreed,
                          put.checks.unchecked);
}

/// One that comes twice may have been followed by a tile that somebody else has drawn.
Result<void> Store::put(const PutDistrusted& put) {
    const auto job = key_of(put.job);
    if (put.worker.worker != WorkerId{}) {
        const auto named = put_distrusted_.run(job, key_of(put.worker.worker),
                                               std::string_view(put.worker.worker_name),
                                               std::string_view(put.worker.reason));
        if (!named || database_.change_count() == 0)
            return named;
    }
    for (const PutDistrusted::Tile& tile : put.tiles)
        for (Statement* drop : {&drop_pixels_of_tile_, &drop_tile_})
            if (const auto done =
                    drop->run(job, static_cast<std::int64_t>(tile.tile), extent_of(tile.size));
                !done)
                return done;
    return {};
}

Result<void> Store::put(const PutTrusted& put) {
    return put_trusted_.run(key_of(put.job), key_of(put.worker));
}

Result<void> Store::put(const PutPriority& put) {
    return set_priority_.run(key_of(put.job), put.priority, counter_of(put.revision),
                             key_of(put.revision.broker));
}

Result<void> Store::put(const PutTerm& put) {
    return set_term_.run(
        static_cast<std::int64_t>(std::min<std::uint64_t>(put.counter, INT64_MAX / 2)));
}

Result<void> Store::put(const PutNumber& put) {
    if (const auto done = set_number_.run(key_of(put.job), put.number, counter_of(put.revision),
                                          key_of(put.revision.broker));
        !done)
        return done;
    return raise_number_.run(put.number);
}

Result<void> Store::put(const ForgetJob& forget) {
    if (const auto done = forget.may_come_back ? drop(forget.job) : bury(forget.job); !done)
        return done;
    return drop_unused_blobs();
}

Result<void> Store::drop(const JobId& job) {
    for (Statement* drop : {&drop_pixels_, &drop_tiles_, &drop_distrusted_, &drop_job_})
        if (const auto done = drop->run(key_of(job)); !done)
            return done;
    return {};
}

Result<void> Store::bury(const JobId& job) {
    if (const auto done = drop(job); !done)
        return done;
    if (const auto done = put_tombstone_.run(key_of(job), now()); !done)
        return done;
    return drop_old_tombstones_.run(options_.tombstones_max);
}

Result<void> Store::drop_unused_blobs() {
    if (const auto done = drop_pieces_.run(); !done)
        return done;
    return drop_blobs_.run();
}

std::int64_t Store::now() const {
    return std::chrono::duration_cast<Duration>(options_.wall_clock().time_since_epoch()).count();
}

} // namespace fraja::broker
