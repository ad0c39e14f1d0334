// A transcript: a story of the broker's core in a text file. Its commands stand at the beginning of
// their lines; what the core does about each stands below it, indented.
#pragma once

#include "common/base/result.hpp"

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace fraja::broker {

struct Replay {
    /// Its commands and comments as they are, below each command what a new core does. Behind an
    /// error all is as it was.
    std::string text;
    /// Names the file and the line: a command that cannot be carried out, or a transcript that does
    /// not open with a comment on what it shows, or has no command.
    std::optional<Error> error;
};
[[nodiscard]] Replay replay(std::string_view text, std::string_view file);

struct Difference {
    std::size_t line = 0; ///< from 1
    std::string before, now;
};
/// The first line that says something else. How a log line is worded does not count, but how
/// serious it is.
[[nodiscard]] std::optional<Difference> first_difference(std::string_view before,
                                                         std::string_view now);

} // namespace fraja::broker
