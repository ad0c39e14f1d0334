#include "broker/store_schema.hpp"

#include <array>
#include <fstream>
#include <string>
#include <string_view>

namespace fraja::broker {
namespace {

namespace fs = std::filesystem;

// Submissions and tiles are kept as bodies of their messages, which are read back whatever version
// of the protocol they are of (protocol::decode_kept). What must be found or changed is beside
// them. Times are nanoseconds, since 1970 where a name ends in _at.
//
// Pixels are apart, so that what a broker makes of a tile when it starts is some hundred bytes;
// they lie in the order in which they came. Scenes are cut in pieces, since SQLite holds at most
// 10^9 bytes in one.
constexpr const char* tables = R"(
CREATE TABLE farm (
    last_number INTEGER NOT NULL, epoch INTEGER NOT NULL, term INTEGER NOT NULL DEFAULT 0
) STRICT;
INSERT INTO farm VALUES (0, 0, 0);
CREATE TABLE jobs (
    job BLOB PRIMARY KEY, number INTEGER NOT NULL, passes INTEGER NOT NULL,
    submission BLOB NOT NULL, scene BLOB NOT NULL, priority INTEGER NOT NULL,
    phase INTEGER NOT NULL, reason TEXT NOT NULL, elapsed INTEGER NOT NULL,
    submitted_at INTEGER NOT NULL, over_at INTEGER,
    revision INTEGER NOT NULL, revised_by BLOB NOT NULL,
    agreed INTEGER NOT NULL DEFAULT 0, unchecked INTEGER NOT NULL DEFAULT 0
) STRICT, WITHOUT ROWID;
CREATE TABLE distrusted (
    job BLOB NOT NULL, worker BLOB NOT NULL, worker_name TEXT NOT NULL, reason TEXT NOT NULL,
    PRIMARY KEY (job, worker)
) STRICT, WITHOUT ROWID;
CREATE INDEX jobs_by_scene ON jobs (scene);
CREATE TABLE tiles (
    job BLOB NOT NULL, tile INTEGER NOT NULL, extent INTEGER NOT NULL,
    body BLOB NOT NULL, pixels INTEGER NOT NULL, pixels_hash BLOB NOT NULL,
    PRIMARY KEY (job, tile, extent)
) STRICT, WITHOUT ROWID;
CREATE TABLE pixels (id INTEGER PRIMARY KEY, bytes BLOB NOT NULL) STRICT;
CREATE TABLE blobs (id INTEGER PRIMARY KEY, hash BLOB NOT NULL UNIQUE, size INTEGER NOT NULL) STRICT;
CREATE TABLE pieces (
    blob INTEGER NOT NULL, piece INTEGER NOT NULL, bytes BLOB NOT NULL, PRIMARY KEY (blob, piece)
) STRICT;
CREATE TABLE tombstones (
    id INTEGER PRIMARY KEY, job BLOB NOT NULL UNIQUE, forgotten_at INTEGER NOT NULL
) STRICT;
)";

// From each version to the next one, in place.
//
// The first one knew no other brokers.
constexpr const char* from_version_1 = R"(
ALTER TABLE jobs ADD COLUMN revision INTEGER NOT NULL DEFAULT 0;
ALTER TABLE jobs ADD COLUMN revised_by BLOB NOT NULL
    DEFAULT x'00000000000000000000000000000000';
)";

// The second one compared no tiles.
constexpr const char* from_version_2 = R"(
ALTER TABLE jobs ADD COLUMN agreed INTEGER NOT NULL DEFAULT 0;
ALTER TABLE jobs ADD COLUMN unchecked INTEGER NOT NULL DEFAULT 0;
CREATE TABLE distrusted (
    job BLOB NOT NULL, worker BLOB NOT NULL, worker_name TEXT NOT NULL, reason TEXT NOT NULL,
    PRIMARY KEY (job, worker)
) STRICT, WITHOUT ROWID;
)";

// The third one had its terms from its own clock alone. Its table is made anew, since there have
// been stores of that version with the column and without it; a term that is lost costs nothing, as
// the clock is ahead of it unless it was set back.
constexpr const char* from_version_3 = R"(
CREATE TABLE new_farm (
    last_number INTEGER NOT NULL, epoch INTEGER NOT NULL, term INTEGER NOT NULL DEFAULT 0
) STRICT;
INSERT INTO new_farm (last_number, epoch) SELECT last_number, epoch FROM farm;
DROP TABLE farm;
ALTER TABLE new_farm RENAME TO farm;
)";

constexpr std::array to_the_next{from_version_1, from_version_2, from_version_3};
static_assert(to_the_next.size() + 1 == store_version);

// No auto_vacuum: what a forgotten job leaves is used by the next ones, so the file is as large as
// the most that was ever kept, which the broker bounds; giving it back would mean to move pages.
constexpr const char* before_the_first_page = R"(
PRAGMA page_size = 16384;
PRAGMA auto_vacuum = NONE;
)";

// The log is moved into the file every 16 MiB by the writer's own commits, while nobody waits. A
// large scene makes it longer for once; it is cut back after that. What is deleted is not
// overwritten with zeros: it was no secret.
constexpr const char* settings = R"(
PRAGMA wal_autocheckpoint = 1024;
PRAGMA journal_size_limit = 67108864;
PRAGMA cache_size = -4096;
PRAGMA secure_delete = OFF;
PRAGMA cell_size_check = ON;
PRAGMA trusted_schema = OFF;
)";

Error no_store(const fs::path& file) {
    return {ErrorCode::invalid_argument,
            file.string() + ": this is no store of fraja-broker. It was left as it "
                            "is: give another --state"};
}

/// Looks at the first bytes before SQLite does, for which an unknown file is a damaged one.
Result<void> check_is_database(const fs::path& file) {
    constexpr std::string_view magic("SQLite format 3\0", 16);
    std::error_code ec;
    if (!fs::exists(file, ec))
        return {};
    if (!fs::is_regular_file(file, ec))
        return no_store(file);
    std::array<char, magic.size()> start{};
    std::ifstream stream(file, std::ios::binary);
    if (!stream)
        return Error{ErrorCode::io,
                     file.string() + ": cannot be read. Mend that, or give another --state"};
    stream.read(start.data(), start.size());
    const std::string_view read(start.data(), static_cast<std::size_t>(stream.gcount()));
    if (!read.empty() && read != magic)
        return no_store(file);
    return {};
}

constexpr std::int64_t nothing_yet = 0;

/// Of a store that this broker knows, or `nothing_yet`: made a moment ago, or by a broker that was
/// killed at once.
Result<std::int64_t> version_of(Database& database) {
    const auto application = database.integer("PRAGMA application_id");
    if (!application)
        return application.error();
    const auto version = database.integer("PRAGMA user_version");
    if (!version)
        return version.error();
    const auto things = database.integer("SELECT count(*) FROM sqlite_schema");
    if (!things)
        return things.error();
    if (*application == 0 && *version == 0 && *things == 0)
        return nothing_yet;
    if (*application != store_application_id)
        return no_store(database.file());
    if (*version > store_version)
        return Error{ErrorCode::version_mismatch,
                     database.file().string() +
                         " was written by a newer fraja-broker (store version " +
                         std::to_string(*version) + ", this one knows " +
                         std::to_string(store_version) + "): use that one, or another --state"};
    if (*version < 1 || *things == 0)
        return damaged(database.file(), "store version " + std::to_string(*version));
    return *version;
}

Result<void> check_pages(Database& database) {
    const auto found = database.text("PRAGMA quick_check(1)");
    if (!found)
        return found.error();
    if (*found != "ok")
        return damaged(database.file(), *found);
    return {};
}

Result<void> use_log(Database& database) {
    const auto mode = database.text("PRAGMA journal_mode = WAL");
    if (!mode)
        return mode.error();
    if (*mode != "wal")
        return Error{ErrorCode::io, database.file().string() +
                                        ": this file system cannot hold a store (SQLite has no "
                                        "log there): give another --state"};
    return {};
}

Result<void> make_tables(Database& database) {
    if (const auto done = database.execute(before_the_first_page); !done)
        return done;
    if (const auto done = use_log(database); !done)
        return done;
    return database.execute(
        "BEGIN IMMEDIATE; PRAGMA application_id = " + std::to_string(store_application_id) +
        "; PRAGMA user_version = " + std::to_string(store_version) + ";" + tables + "COMMIT");
}

/// All steps from `version` on, or none.
Result<void> bring_up_to_date(Database& database, std::int64_t version) {
    if (version == store_version)
        return {};
    std::string steps = "BEGIN IMMEDIATE;";
    for (auto i = static_cast<std::size_t>(version - 1); i < to_the_next.size(); ++i)
        steps += to_the_next[i];
    return database.execute(steps + "PRAGMA user_version = " + std::to_string(store_version) +
                            "; COMMIT");
}

} // namespace

Result<Database> open_store_file(const fs::path& file) {
    if (const auto is_one = check_is_database(file); !is_one)
        return is_one.error();
    auto database = Database::open(file, DatabaseAccess::writing);
    if (!database)
        return database.error();
    const auto version = version_of(*database);
    if (!version)
        return version.error();
    const auto ready = *version == nothing_yet ? make_tables(*database) : check_pages(*database);
    if (!ready)
        return ready.error();
    if (const auto log = use_log(*database); !log)
        return log.error();
    if (*version != nothing_yet)
        if (const auto done = bring_up_to_date(*database, *version); !done)
            return done.error();
    if (const auto set = database->execute(settings); !set)
        return set.error();
    database->set_untouched(false);
    return database;
}

Result<Database> open_store_file_to_read(const fs::path& file) {
    return Database::open(file, DatabaseAccess::reading);
}

} // namespace fraja::broker
