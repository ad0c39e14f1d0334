#include "common/cli/state_folder.hpp"

#include <cstdlib>

namespace fraja::cli {

std::optional<std::filesystem::path> state_folder() {
    if (const char* state = std::getenv("XDG_STATE_HOME"); state && *state)
        return std::filesystem::path(state) / "fraja";
    if (const char* home = std::getenv("HOME"); home && *home)
        return std::filesystem::path(home) / ".local/state/fraja";
    return std::nullopt;
}

} // namespace fraja::cli
