// Where a broker keeps its jobs unless it is told otherwise.
#pragma once

#include <filesystem>
#include <optional>

namespace fraja::cli {

/// $XDG_STATE_HOME/fraja, or what the XDG specification puts in its place; nothing where this user
/// has no home.
[[nodiscard]] std::optional<std::filesystem::path> state_folder();

} // namespace fraja::cli
