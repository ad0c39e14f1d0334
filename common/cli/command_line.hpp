// How every program reads its command line, and the settings files where options may stand as well.
#pragma once

#include "common/base/result.hpp"

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace CLI {
class App; // the library is large: only the files that read a command line include it
}

namespace fraja::cli {

/// A command line that ends the program: --help, --version, or a mistake.
struct EarlyExit {
    int code = 0;
    std::string text;
    friend bool operator==(const EarlyExit&, const EarlyExit&) = default;
};
template <class Options>
using Parsed = std::variant<Options, EarlyExit>;

/// $XDG_CONFIG_HOME/fraja/config.toml (or that in ~/.config), and then /etc/fraja/config.toml.
[[nodiscard]] std::vector<std::filesystem::path> settings_files();

/// Reads the arguments (without the program's name, which is the app's). An option --like-this that
/// is neither among them nor in its environment variable is looked for in the files, in their
/// order; not one that is excluded by what is given, or is not configurable(). Nothing: all is
/// well.
[[nodiscard]] std::optional<EarlyExit>
parse(CLI::App& app, std::vector<std::string> arguments,
      const std::vector<std::filesystem::path>& files = settings_files());

/// "fraja-submit: error: ... (fraja-submit --help)"
[[nodiscard]] EarlyExit usage_error(std::string_view program, std::string_view message);

/// Prints it where it belongs: help and version on stdout, mistakes on stderr. Returns the code.
int leave(const EarlyExit& exit);

/// The arguments of main, without the program's name.
[[nodiscard]] std::vector<std::string> arguments_of(int argc, char** argv);

} // namespace fraja::cli
