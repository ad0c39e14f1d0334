// Files that appear whole or not at all.
#pragma once

#include "common/base/result.hpp"

#include <cstddef>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>

namespace fraja {

/// Makes `path` a file of these bytes: writes them beside it and renames, so that an older file
/// stays as it is until the new one is complete. A symbolic link is followed, to the file that is
/// replaced. Errors: io; then nothing has changed.
[[nodiscard]] Result<void> replace_file(const std::filesystem::path& path,
                                        std::span<const std::byte> bytes);

/// Whether replace_file() could put an empty file there, found by trying all but the rename.
/// Errors: io (no such directory, no permission, a directory or a write-protected file there).
[[nodiscard]] Result<void> check_replaceable(const std::filesystem::path& path);

/// What went wrong with that file.
[[nodiscard]] inline Error io_error(const std::filesystem::path& path, std::string_view reason) {
    return {ErrorCode::io, path.string() + ": " + std::string(reason)};
}

} // namespace fraja
