// The store's file: what is in it, how it is told from other files, and how it is opened.
#pragma once

#include "broker/sqlite.hpp"
#include "common/base/result.hpp"

#include <cstdint>
#include <filesystem>

namespace fraja::broker {

inline constexpr const char* store_file_name = "fraja.sqlite3";
inline constexpr std::int64_t store_application_id = 0x46524a41; ///< "FRJA"
inline constexpr std::int64_t store_version = 4; ///< of the tables; a newer one is refused

/// Opens the store's file for its one writer; makes it where there is none. Errors, after which the
/// file is as it was: version_mismatch where a newer broker wrote it, invalid_argument where it is
/// none, io where it is damaged or may not be used.
[[nodiscard]] Result<Database> open_store_file(const std::filesystem::path& file);

/// Another connection to a file that is open.
[[nodiscard]] Result<Database> open_store_file_to_read(const std::filesystem::path& file);

} // namespace fraja::broker
