// What is said of a mistake on a command line: the option as it was typed, and the cure.
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace CLI {
class App;
class ParseError;
} // namespace CLI

namespace fraja::cli {

/// One line without the program's name. `app` has thrown the error over `typed`.
[[nodiscard]] std::string mistake(const CLI::App& app, const CLI::ParseError& error,
                                  const std::vector<std::string>& typed);

/// What is said of the first option among `typed`, which the app has read as far as it went, whose
/// value is empty: whoever writes -o '' has a variable that is not set, and does not mean what
/// holds without the option. Nothing: there is none. What is told by its place is the program's
/// matter.
[[nodiscard]] std::optional<std::string> empty_value_in(const CLI::App& app,
                                                        const std::vector<std::string>& typed);

} // namespace fraja::cli
