// SQLite as the store needs it: a database, prepared statements, errors as values. Its own header
// is included by sqlite.cpp alone.
#pragma once

#include "common/base/ids.hpp"
#include "common/base/result.hpp"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>

struct sqlite3;
struct sqlite3_stmt;

namespace fraja::broker {

enum class DatabaseAccess { reading, writing };

/// What is found where data must not be: says which file, and what a person can do.
[[nodiscard]] Error damaged(const std::filesystem::path& file, const std::string& what);

/// A connection. One thread at a time.
class Database {
public:
    /// Made when it is not there and access is `writing`. Error io: no permission, no such
    /// directory.
    [[nodiscard]] static Result<Database> open(const std::filesystem::path& file,
                                               DatabaseAccess access);

    /// Statements without values and rows, separated by semicolons.
    [[nodiscard]] Result<void> execute(const std::string& sql);
    /// The first column of the only row.
    [[nodiscard]] Result<std::int64_t> integer(const std::string& sql);
    [[nodiscard]] Result<std::string> text(const std::string& sql);

    /// Closing it, too, leaves the file as it is. So from the start; when false, what is in the log
    /// beside it is moved into it then.
    void set_untouched(bool untouched);

    [[nodiscard]] std::int64_t last_row_id() const;
    /// Rows that the last INSERT, UPDATE or DELETE has changed.
    [[nodiscard]] std::int64_t change_count() const;
    [[nodiscard]] bool in_transaction() const;
    [[nodiscard]] std::filesystem::path file() const;

private:
    friend class Statement;
    struct Close {
        void operator()(sqlite3* handle) const;
    };
    explicit Database(sqlite3* handle) : handle_(handle) {}
    std::unique_ptr<sqlite3, Close> handle_;
};

/// What a statement finds, row by row. It must end before its statement is used again.
class Rows {
public:
    /// `status`: of preparing and binding, which next() tells.
    Rows(sqlite3* database, sqlite3_stmt* statement, int status)
        : database_(database), statement_(statement), status_(status) {}
    ~Rows();
    Rows(const Rows&) = delete;
    Rows& operator=(const Rows&) = delete;

    /// Whether there is another row, which then is the one the columns are of.
    [[nodiscard]] Result<bool> next();

    // Columns count from 0. What is not copied is valid until next().
    [[nodiscard]] std::int64_t integer(int column) const;
    [[nodiscard]] bool is_null(int column) const;
    [[nodiscard]] std::string text(int column) const;
    [[nodiscard]] std::span<const std::byte> bytes(int column) const;

private:
    sqlite3* database_;
    sqlite3_stmt* statement_;
    int status_;
};

/// Prepared when it is first used, and kept. It must not outlive its database.
class Statement {
public:
    /// `sql` must outlive it.
    Statement(Database& database, const char* sql) : database_(database.handle_.get()), sql_(sql) {}

    /// `values` become ?1, ?2, ...: integers, text, bytes. They must live as long as the rows do.
    template <class... Values>
    [[nodiscard]] Rows query(const Values&... values) {
        int status = prepare();
        int at = 0;
        (bind(status, ++at, values), ...);
        return Rows(database_, statement_.get(), status);
    }
    /// Of a statement without rows.
    template <class... Values>
    [[nodiscard]] Result<void> run(const Values&... values) {
        Rows rows = query(values...);
        const auto done = rows.next();
        return done ? Result<void>() : Result<void>(done.error());
    }

private:
    int prepare();
    /// Nothing happens where `status` is bad.
    void bind(int& status, int at, std::int64_t value);
    void bind(int& status, int at, std::string_view text);
    void bind(int& status, int at, std::span<const std::byte> bytes);

    struct Finalize {
        void operator()(sqlite3_stmt* statement) const;
    };
    sqlite3* database_;
    const char* sql_;
    std::unique_ptr<sqlite3_stmt, Finalize> statement_;
};

/// An id's or a hash's bytes, to be bound.
[[nodiscard]] inline std::span<const std::byte> key_of(const auto& id) {
    return std::as_bytes(std::span(id.bytes));
}

} // namespace fraja::broker
