// Key files: a key pair in TOML, made by fraja-ctl keygen for its owner's eyes alone.
#pragma once

#include "common/base/result.hpp"

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>

namespace fraja::cli {

inline constexpr std::size_t key_file_bytes_max = 16'384;

/// As it stands there; nobody has looked whether these are keys.
struct KeyFile {
    std::string public_key;
    std::string broker; ///< public key of the broker to connect to; may be empty
    std::string secret; ///< wiped in the end

    KeyFile() = default;
    ~KeyFile();
    KeyFile(KeyFile&& other) noexcept;
    KeyFile& operator=(KeyFile&&) = delete;
};

/// Errors: io, and of a file that others may read or that is somebody else's, with the cure;
/// invalid_argument for what is no key file. What stands in it is never quoted, nor is `file` where
/// it looks like a key itself.
[[nodiscard]] Result<KeyFile> read_key_file(const std::filesystem::path& file);

/// Makes the file, for its owner alone (0600). Errors: io, also where there is a file: it is never
/// overwritten.
[[nodiscard]] Result<void> write_key_file(const std::filesystem::path& file,
                                          std::string_view public_key, std::string_view secret,
                                          std::string_view broker);

} // namespace fraja::cli
