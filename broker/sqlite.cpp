#include "broker/sqlite.hpp"

#include "common/base/assert.hpp"

#include <sqlite3.h>
#include <system_error>

namespace fraja::broker {
namespace {

constexpr int busy_patience_ms = 2'000; // a person may be looking at it with another program

std::string errno_text(int number) {
    return std::error_code(number, std::generic_category()).message();
}

Error error_of(const std::filesystem::path& file, sqlite3* database, int status) {
    const std::string said = database ? sqlite3_errmsg(database) : sqlite3_errstr(status);
    const int number = database ? sqlite3_system_errno(database) : 0;
    const std::string why = number != 0 ? said + " (" + errno_text(number) + ")" : said;
    switch (status & 0xff) { // the rest is detail
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
        return damaged(file, said);
    case SQLITE_FULL:
        return {ErrorCode::io, file.string() + ": there is no more space for it"};
    case SQLITE_PERM:
    case SQLITE_READONLY:
    case SQLITE_CANTOPEN:
        return {ErrorCode::io, file.string() + ": cannot be opened or written: " + why};
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
        return {ErrorCode::io, file.string() + ": another program is holding it"};
    default:
        return {ErrorCode::io, file.string() + ": " + why};
    }
}

Error error_of(sqlite3* database, int status) {
    return error_of(sqlite3_db_filename(database, "main"), database, status);
}

} // namespace

Error damaged(const std::filesystem::path& file, const std::string& what) {
    return {ErrorCode::io, file.string() + " is damaged (" + what +
                               "). It was left as it is: put a copy in its place, or give another "
                               "--state"};
}

// --------------------------------------------------------------------------------------- Database

void Database::Close::operator()(sqlite3* handle) const {
    sqlite3_close_v2(handle);
}

Result<Database> Database::open(const std::filesystem::path& file, DatabaseAccess access) {
    const int flags = access == DatabaseAccess::reading
                          ? SQLITE_OPEN_READONLY
                          : SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE;
    sqlite3* handle = nullptr;
    // FULLMUTEX costs nothing that shows, and a mistake with threads then is no damage.
    const int status =
        sqlite3_open_v2(file.c_str(), &handle, flags | SQLITE_OPEN_FULLMUTEX, nullptr);
    Database database(handle);
    if (status != SQLITE_OK)
        return error_of(file, handle, status);
    sqlite3_extended_result_codes(handle, 1);
    sqlite3_busy_timeout(handle, busy_patience_ms);
    database.set_untouched(true);
    // A file that may not be written is opened for reading, whatever was asked for.
    if (access == DatabaseAccess::writing && sqlite3_db_readonly(handle, "main") != 0)
        return error_of(file, nullptr, SQLITE_READONLY);
    return database;
}

Result<void> Database::execute(const std::string& sql) {
    const int status = sqlite3_exec(handle_.get(), sql.c_str(), nullptr, nullptr, nullptr);
    if (status != SQLITE_OK)
        return error_of(handle_.get(), status);
    return {};
}

Result<std::int64_t> Database::integer(const std::string& sql) {
    Statement statement(*this, sql.c_str());
    Rows rows = statement.query();
    const auto found = rows.next();
    if (!found)
        return found.error();
    FRAJA_ASSERT(*found);
    return rows.integer(0);
}

Result<std::string> Database::text(const std::string& sql) {
    Statement statement(*this, sql.c_str());
    Rows rows = statement.query();
    const auto found = rows.next();
    if (!found)
        return found.error();
    FRAJA_ASSERT(*found);
    return rows.text(0);
}

void Database::set_untouched(bool untouched) {
    sqlite3_db_config(handle_.get(), SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, untouched ? 1 : 0, nullptr);
}

std::int64_t Database::last_row_id() const {
    return sqlite3_last_insert_rowid(handle_.get());
}

std::int64_t Database::change_count() const {
    return sqlite3_changes64(handle_.get());
}

bool Database::in_transaction() const {
    return sqlite3_get_autocommit(handle_.get()) == 0;
}

std::filesystem::path Database::file() const {
    return sqlite3_db_filename(handle_.get(), "main");
}

// ------------------------------------------------------------------------------- Statement and
// Rows

void Statement::Finalize::operator()(sqlite3_stmt* statement) const {
    sqlite3_finalize(statement);
}

int Statement::prepare() {
    if (statement_)
        return SQLITE_OK;
    sqlite3_stmt* statement = nullptr;
    const int status =
        sqlite3_prepare_v3(database_, sql_, -1, SQLITE_PREPARE_PERSISTENT, &statement, nullptr);
    statement_.reset(statement);
    return status;
}

void Statement::bind(int& status, int at, std::int64_t value) {
    if (status == SQLITE_OK)
        status = sqlite3_bind_int64(statement_.get(), at, value);
}

void Statement::bind(int& status, int at, std::string_view text) {
    if (status == SQLITE_OK)
        status = sqlite3_bind_text64(statement_.get(), at, text.data() ? text.data() : "",
                                     text.size(), SQLITE_STATIC, SQLITE_UTF8);
}

void Statement::bind(int& status, int at, std::span<const std::byte> bytes) {
    static constexpr std::byte nowhere{}; // a null pointer would be bound as NULL
    if (status == SQLITE_OK)
        status = sqlite3_bind_blob64(statement_.get(), at, bytes.empty() ? &nowhere : bytes.data(),
                                     bytes.size(), SQLITE_STATIC);
}

Rows::~Rows() {
    if (statement_) { // what was bound may end with the caller's values
        sqlite3_reset(statement_);
        sqlite3_clear_bindings(statement_);
    }
}

Result<bool> Rows::next() {
    if (status_ == SQLITE_OK || status_ == SQLITE_ROW)
        status_ = sqlite3_step(statement_);
    if (status_ == SQLITE_ROW || status_ == SQLITE_DONE)
        return status_ == SQLITE_ROW;
    return error_of(database_, status_);
}

std::int64_t Rows::integer(int column) const {
    return sqlite3_column_int64(statement_, column);
}

bool Rows::is_null(int column) const {
    return sqlite3_column_type(statement_, column) == SQLITE_NULL;
}

std::string Rows::text(int column) const {
    const auto bytes_of_text = bytes(column);
    return {reinterpret_cast<const char*>(bytes_of_text.data()), bytes_of_text.size()};
}

std::span<const std::byte> Rows::bytes(int column) const {
    const void* data = sqlite3_column_blob(statement_, column); // before its size is asked for
    return {static_cast<const std::byte*>(data),
            static_cast<std::size_t>(sqlite3_column_bytes(statement_, column))};
}

} // namespace fraja::broker
