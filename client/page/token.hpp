// The token that opens the live page where more than this machine can reach it.
#pragma once

#include "common/base/result.hpp"

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>

namespace fraja::client {

inline constexpr std::size_t token_chars_min = 16, token_chars_max = 200;

/// 256 random bits as 43 letters, digits, - and _.
[[nodiscard]] std::string fresh_token();

/// The first line of a file that nobody but its owner may read: letters, digits, - and _, as many
/// as the limits say. Errors: io, invalid_argument; they name the cure.
[[nodiscard]] Result<std::string> read_token(const std::filesystem::path& path);

/// Takes as long wherever the two differ.
[[nodiscard]] bool is_same_token(std::string_view a, std::string_view b);

} // namespace fraja::client
