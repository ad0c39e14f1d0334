// Settings files: options in TOML, for all programs or for one.
#pragma once

#include "common/base/result.hpp"

#include <array>
#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace fraja::cli {

inline constexpr std::size_t settings_file_bytes_max = std::size_t{1} << 20;

/// Which may have a table.
inline constexpr std::array<std::string_view, 5> programs = {
    "fraja-broker", "fraja-worker", "fraja-submit", "fraja-watch", "fraja-ctl"};

/// An option as it stands in a file, without its dashes.
struct Setting {
    std::string option;
    std::vector<std::string> values; ///< as they would be typed; several where a list stands
    std::string place;               ///< "/etc/fraja/config.toml:3:1"
    friend bool operator==(const Setting&, const Setting&) = default;
};

/// What the file says to `program`: the table of its name, and of what stands before all tables
/// that which the table leaves open. `options` are those the program has. Before the tables stand
/// options that all or several programs share; a program passes over those that it lacks. A file
/// that is not there says nothing. Errors, with file, line and column: io; invalid_argument for
/// what is not TOML, a table or option that no program has, a value that is neither text, number
/// nor truth value.
[[nodiscard]] Result<std::vector<Setting>> read_settings(const std::filesystem::path& file,
                                                         std::string_view program,
                                                         const std::vector<std::string>& options);

} // namespace fraja::cli
