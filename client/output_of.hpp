// What another program says on its standard output.
#pragma once

#include "common/base/instant.hpp"

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace fraja::client {

inline constexpr std::size_t output_bytes_max = std::size_t{64} << 10; ///< more is cut off

/// Runs `argv`, its path first, without input, and waits for its end. Nothing where it cannot be
/// run, or has not closed its output after `timeout`: then it is killed.
[[nodiscard]] std::optional<std::string> output_of(std::vector<std::string> argv, Duration timeout);

} // namespace fraja::client
