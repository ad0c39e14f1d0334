// What is said of a mistake on a command line: the option as it was typed, and the cure.
#pragma once

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

} // namespace fraja::cli
