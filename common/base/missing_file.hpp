// What is said of a file that is not there.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

namespace fraja {

/// Of a larger folder no more names are looked at.
inline constexpr std::size_t names_looked_at_max = 10'000;

/// "scenes/coen.raj: there is no such file (did you mean 'scenes/cone.raj'?)"; of a path that is
/// not absolute also in which folder it was looked for, where nothing there is named alike. A
/// folder that cannot be read has no names. Files with the extension that is `wanted` come first.
[[nodiscard]] std::string missing_file(const std::filesystem::path& path,
                                       const std::filesystem::path& wanted);

} // namespace fraja
