// Options that every client shares, and how command lines are read.
#pragma once

#include "client/console.hpp"
#include "client/preview/preview.hpp"
#include "client/session.hpp"
#include "common/base/result.hpp"
#include "common/base/version.hpp"

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace CLI {
class App; // the library is large: only the files that read a command line include it
}

namespace fraja::client {

enum class ProgressMode : std::uint8_t { automatic, bar, plain, json, none };

struct SharedOptions {
    std::vector<std::string> brokers; ///< whole endpoints, at least one
    Duration connect_timeout = std::chrono::seconds(10);
    ProgressMode progress = ProgressMode::automatic;
    ConsoleOptions console;
    bool json = false;
};

/// A command line that ends the program: --help, --version, or a mistake.
struct EarlyExit {
    int code = 0;
    std::string text;
    friend bool operator==(const EarlyExit&, const EarlyExit&) = default;
};
template <class Options>
using Parsed = std::variant<Options, EarlyExit>;

/// The shared options as they are typed, until all of the line has been read.
class SharedArguments {
public:
    /// Adds --broker and its companions to `app`; this must outlive the parsing. --version names
    /// `isa`.
    void add_to(CLI::App& app, std::string program, std::string_view isa = isa_level());
    [[nodiscard]] Result<SharedOptions> read() const;

private:
    std::string program_;
    std::vector<std::string> brokers_;
    std::string connect_timeout_ = "10s", progress_ = "auto", color_ = "auto", log_level_ = "info";
    bool json_ = false;
};

/// --preview as it is typed.
class PreviewArgument {
public:
    /// Without it: `absent`, one of the modes. Where it `may_stand_alone`, that means auto; then a
    /// mode is given as --preview=MODE.
    void add_to(CLI::App& app, std::string absent, bool may_stand_alone);
    [[nodiscard]] PreviewMode read() const;

private:
    std::string mode_;
};

/// Reads the arguments (without the program's name). Nothing: all is well.
[[nodiscard]] std::optional<EarlyExit> parse(CLI::App& app, std::vector<std::string> arguments);

/// "fraja-submit: error: ... (fraja-submit --help)"
[[nodiscard]] EarlyExit usage_error(std::string_view program, std::string_view message);

/// Prints it where it belongs: help and version on stdout, mistakes on stderr. Returns the code.
int leave(const EarlyExit& exit);

/// For keep_freed_memory(): little, as a picture is memory enough.
inline constexpr std::size_t kept_freed_bytes = std::size_t{8} << 20;

/// The arguments of main, without the program's name.
[[nodiscard]] std::vector<std::string> arguments_of(int argc, char** argv);

[[nodiscard]] SessionOptions session_options(const SharedOptions& shared);

[[nodiscard]] inline Error invalid_option(std::string message) {
    return {ErrorCode::invalid_argument, std::move(message)};
}

} // namespace fraja::client
