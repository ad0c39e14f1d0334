// How every program reads its command line, and how it ends over one.
#pragma once

#include "common/cli/completion.hpp"
#include "common/cli/origins.hpp"
#include "common/cli/settings.hpp"

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace CLI {
class App; // the library is large: only the files that describe a command line include it
}

namespace fraja::cli {

/// A command line that ends the program: --help, --version, or a mistake.
struct EarlyExit {
    int code = 0;
    std::string text;
    friend bool operator==(const EarlyExit&, const EarlyExit&) = default;
};

/// Reads the arguments (without the program's name), and for what is not among them the settings
/// `files` (take_settings()); notes in `origins` where options come from. Nothing: all is well.
/// `app` has the program's name. Answers also what
/// --help does not show, as it is for shells and the build: --complete WORD... (completions(),
/// which may ask `names`), --completion SHELL (completion_script() for this program), --manual
/// (manual_sections()), --check-settings (what is wrong in the files, a line; nothing: all is
/// well); each as the first argument.
[[nodiscard]] std::optional<EarlyExit>
parse(CLI::App& app, std::vector<std::string> arguments, Origins& origins,
      const NameSource& names = {},
      const std::vector<std::filesystem::path>& files = settings_files());

/// "fraja-submit: error: ... (fraja-submit --help)", and exit code 2.
[[nodiscard]] EarlyExit usage_error(std::string_view program, std::string_view message);

/// The same where the command line is as it should be, and the world is not.
[[nodiscard]] EarlyExit failure(std::string_view program, std::string_view message);
/// With exit code 75 where another program has what is needed: it may be free the next time.
[[nodiscard]] EarlyExit failure(std::string_view program, const Error& error);

/// Prints it where it belongs: help and version on stdout, mistakes on stderr. Returns the code.
int leave(const EarlyExit& exit);

/// The arguments of main, without the program's name.
[[nodiscard]] std::vector<std::string> arguments_of(int argc, char** argv);

} // namespace fraja::cli
