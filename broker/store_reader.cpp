#include "broker/store_reader.hpp"

#include "broker/store_schema.hpp"
#include "common/protocol/codec.hpp"
#include "common/protocol/content_hash.hpp"
#include "common/protocol/limits.hpp"

#include <algorithm>
#include <cstring>
#include <limits>
#include <map>
#include <utility>

namespace fraja::broker {
namespace {

/// A column that holds an id or a hash. False: it is none.
template <class Id>
bool read_key(const Rows& rows, int column, Id& id) {
    const auto bytes = rows.bytes(column);
    if (bytes.size() != id.bytes.size())
        return false;
    std::memcpy(id.bytes.data(), bytes.data(), bytes.size());
    return true;
}

/// A column that holds a number from 0 to T's largest. False: it does not.
template <class T>
bool read_number(const Rows& rows, int column, T& number) {
    const std::int64_t value = rows.integer(column);
    if (value < 0 || std::cmp_greater(value, std::numeric_limits<T>::max()))
        return false;
    number = static_cast<T>(value);
    return true;
}

bool read_phase(const Rows& rows, int column, protocol::JobPhase& phase) {
    std::uint8_t number = 0;
    if (!read_number(rows, column, number) ||
        number >= protocol::ValueCount<protocol::JobPhase>::value)
        return false;
    phase = protocol::JobPhase{number};
    return true;
}

/// Calls `take(rows)` for each row; it returns what is wrong with that, or nothing.
template <class Take>
Result<void> for_each_row(const Database& database, Rows rows, Take take) {
    for (;;) {
        const auto more = rows.next();
        if (!more)
            return more.error();
        if (!*more)
            return {};
        if (const std::string wrong = take(rows); !wrong.empty())
            return damaged(database.file(), wrong);
    }
}

} // namespace

StoreReader::StoreReader(Database database, WallClock wall_clock)
    : database_(std::move(database)), wall_clock_(std::move(wall_clock)),
      begin_(database_, "BEGIN"), commit_(database_, "COMMIT"),
      jobs_(database_, "SELECT submission, number, passes, priority, phase, reason, elapsed, "
                       "submitted_at, over_at, revision, revised_by, agreed, unchecked "
                       "FROM jobs ORDER BY number"),
      all_tiles_(database_,
                 "SELECT job, tile, body, pixels_hash FROM tiles ORDER BY job, tile, extent"),
      distrusted_(database_, "SELECT job, worker, worker_name, reason FROM distrusted "
                             "ORDER BY job, worker"),
      blobs_(database_, "SELECT hash, size FROM blobs ORDER BY hash"),
      tombstones_(database_, "SELECT job, forgotten_at FROM tombstones ORDER BY id"),
      farm_(database_, "SELECT last_number, term FROM farm"),
      tile_(database_, "SELECT body, pixels_hash, bytes FROM tiles JOIN pixels "
                       "ON pixels.id = tiles.pixels WHERE job = ?1 AND tile = ?2"),
      blob_size_(database_, "SELECT size FROM blobs WHERE hash = ?1"),
      pieces_(database_, "SELECT bytes FROM pieces WHERE blob = "
                         "(SELECT id FROM blobs WHERE hash = ?1) ORDER BY piece") {}

Result<StoreReader> StoreReader::open(const Store& store, WallClock wall_clock) {
    auto database = open_store_file_to_read(store.file());
    if (!database)
        return database.error();
    return StoreReader(std::move(*database), std::move(wall_clock));
}

Duration StoreReader::since(std::int64_t at) const {
    const Duration now = std::chrono::duration_cast<Duration>(wall_clock_().time_since_epoch());
    return at < now.count() ? now - Duration(std::max<std::int64_t>(at, 0)) : Duration::zero();
}

// --------------------------------------------------------------------------------- all that is
// kept

Result<Contents> StoreReader::read() {
    if (const auto begun = begin_.run(); !begun) // all of it as it was at one moment
        return begun.error();
    auto contents = read_all();
    if (const auto ended = commit_.run(); !ended)
        return ended.error();
    return contents;
}

Result<Contents> StoreReader::read_all() {
    Contents contents;
    for (const auto part :
         {&StoreReader::read_jobs, &StoreReader::read_tiles, &StoreReader::read_distrusted,
          &StoreReader::read_blobs, &StoreReader::read_tombstones, &StoreReader::read_farm})
        if (const auto done = (this->*part)(contents); !done)
            return done.error();
    return contents;
}

Result<void> StoreReader::read_jobs(Contents& contents) {
    return for_each_row(database_, jobs_.query(), [&](const Rows& rows) -> std::string {
        auto submission = protocol::decode_kept<protocol::SubmitJob>(rows.bytes(0));
        if (!submission)
            return submission.error().message;
        StoredJob job;
        job.submission = std::move(*submission);
        if (!read_number(rows, 1, job.number) || !read_number(rows, 2, job.passes) ||
            !read_phase(rows, 4, job.phase))
            return "job " + to_string(job.submission.job);
        job.submission.priority = static_cast<std::int32_t>(rows.integer(3));
        job.reason = rows.text(5);
        job.elapsed = Duration(rows.integer(6));
        job.age = since(rows.integer(7));
        if (!rows.is_null(8))
            job.over_for = since(rows.integer(8));
        if (!read_number(rows, 9, job.revision.counter) ||
            !read_key(rows, 10, job.revision.broker) || !read_number(rows, 11, job.checks.agreed) ||
            !read_number(rows, 12, job.checks.unchecked))
            return "job " + to_string(job.submission.job);
        contents.jobs.push_back(std::move(job));
        return {};
    });
}

Result<void> StoreReader::read_tiles(Contents& contents) {
    std::map<JobId, StoredJob*> jobs;
    for (StoredJob& job : contents.jobs)
        jobs[job.submission.job] = &job;
    return for_each_row(database_, all_tiles_.query(), [&](const Rows& rows) -> std::string {
        JobId id;
        std::uint32_t index = 0;
        const auto tile = protocol::decode_kept<protocol::TileDone>(rows.bytes(2));
        if (!tile)
            return tile.error().message;
        ContentHash pixels;
        if (!read_key(rows, 0, id) || !read_number(rows, 1, index) || !jobs.contains(id) ||
            tile->job != id || tile->tile != TileIndex{index} || !read_key(rows, 3, pixels))
            return "a tile of job " + to_string(id);
        jobs[id]->tiles.push_back({.tile = tile->tile,
                                   .frame = tile->frame,
                                   .pass = tile->pass,
                                   .rect = tile->rect,
                                   .rays = tile->rays,
                                   .elapsed = tile->elapsed,
                                   .worker = tile->worker,
                                   .worker_name = tile->worker_name,
                                   .pixels = pixels});
        return {};
    });
}

Result<void> StoreReader::read_distrusted(Contents& contents) {
    std::map<JobId, StoredJob*> jobs;
    for (StoredJob& job : contents.jobs)
        jobs[job.submission.job] = &job;
    return for_each_row(database_, distrusted_.query(), [&](const Rows& rows) -> std::string {
        JobId id;
        protocol::Distrusted distrusted;
        if (!read_key(rows, 0, id) || !read_key(rows, 1, distrusted.worker) || !jobs.contains(id) ||
            jobs[id]->distrusted.size() >= protocol::distrusted_max)
            return "a distrusted worker of job " + to_string(id);
        distrusted.worker_name = rows.text(2);
        distrusted.reason = rows.text(3);
        jobs[id]->distrusted.push_back(std::move(distrusted));
        return {};
    });
}

Result<void> StoreReader::read_blobs(Contents& contents) {
    return for_each_row(database_, blobs_.query(), [&](const Rows& rows) -> std::string {
        StoredBlob blob;
        if (!read_key(rows, 0, blob.hash) || !read_number(rows, 1, blob.size_bytes))
            return "scene " + to_string(blob.hash);
        contents.blobs.push_back(blob);
        return {};
    });
}

Result<void> StoreReader::read_tombstones(Contents& contents) {
    return for_each_row(database_, tombstones_.query(), [&](const Rows& rows) -> std::string {
        Tombstone tombstone;
        if (!read_key(rows, 0, tombstone.job))
            return "a tombstone";
        tombstone.age = since(rows.integer(1));
        contents.tombstones.push_back(tombstone);
        return {};
    });
}

Result<void> StoreReader::read_farm(Contents& contents) {
    return for_each_row(database_, farm_.query(), [&](const Rows& rows) -> std::string {
        if (!read_number(rows, 0, contents.last_number))
            return "the last job's number";
        return read_number(rows, 1, contents.last_term) ? "" : "the last term";
    });
}

// ------------------------------------------------------------------------------ what is asked for

Result<std::vector<protocol::TileDone>> StoreReader::tiles(const JobId& job,
                                                           std::span<const TileIndex> which) {
    std::vector<protocol::TileDone> found;
    for (const TileIndex index : which) {
        if (const auto done = append_tiles(job, index, found); !done)
            return done.error();
    }
    return found;
}

Result<void> StoreReader::append_tiles(const JobId& job, TileIndex which,
                                       std::vector<protocol::TileDone>& found) {
    return for_each_row(database_, tile_.query(key_of(job), static_cast<std::int64_t>(which)),
                        [&](const Rows& rows) -> std::string {
                            auto body = protocol::decode_kept<protocol::TileDone>(rows.bytes(0));
                            if (!body)
                                return body.error().message;
                            const auto pixels = rows.bytes(2);
                            ContentHash hash;
                            // SQLite's own check of a file does not look at what is in it.
                            if (!read_key(rows, 1, hash) || protocol::content_hash(pixels) != hash)
                                return "the pixels of tile " +
                                       std::to_string(static_cast<std::uint32_t>(which)) +
                                       " of job " + to_string(job);
                            found.push_back(std::move(*body));
                            found.back().blobs = cut(Blob::copy(pixels), protocol::chunk_bytes);
                            return {};
                        });
}

Result<std::optional<Bytes>> StoreReader::blob(const ContentHash& hash) {
    if (const auto begun = begin_.run(); !begun) // size and pieces of one moment
        return begun.error();
    auto found = read_blob(hash);
    if (const auto ended = commit_.run(); !ended)
        return ended.error();
    return found;
}

Result<std::optional<Bytes>> StoreReader::read_blob(const ContentHash& hash) {
    std::optional<std::uint64_t> size;
    auto done = for_each_row(
        database_, blob_size_.query(key_of(hash)), [&](const Rows& rows) -> std::string {
            return read_number(rows, 0, size.emplace()) ? "" : "a scene's size";
        });
    if (!done)
        return done.error();
    if (!size)
        return std::optional<Bytes>();
    Bytes bytes;
    bytes.reserve(std::min(*size, protocol::scene_bytes_max));
    done = for_each_row(database_, pieces_.query(key_of(hash)), [&](const Rows& rows) {
        const auto piece = rows.bytes(0);
        bytes.insert(bytes.end(), piece.begin(), piece.end());
        return std::string();
    });
    if (!done)
        return done.error();
    if (bytes.size() != *size || protocol::content_hash(bytes) != hash)
        return damaged(database_.file(), "scene " + to_string(hash));
    return std::optional<Bytes>(std::move(bytes));
}

} // namespace fraja::broker
