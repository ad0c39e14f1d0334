// Options that every client shares.
#pragma once

#include "client/console.hpp"
#include "client/session.hpp"
#include "common/base/result.hpp"
#include "common/base/version.hpp"
#include "common/cli/parse.hpp"

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace fraja::client {

enum class ProgressMode : std::uint8_t { automatic, bar, plain, json, none };

struct SharedOptions {
    std::vector<std::string> brokers; ///< whole endpoints, at least one
    Duration connect_timeout = std::chrono::seconds(10);
    ProgressMode progress = ProgressMode::automatic;
    ConsoleOptions console;
    bool json = false;
};

using cli::EarlyExit;
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

/// For keep_freed_memory(): little, as a picture is memory enough.
inline constexpr std::size_t kept_freed_bytes = std::size_t{8} << 20;

[[nodiscard]] SessionOptions session_options(const SharedOptions& shared);

[[nodiscard]] inline Error invalid_option(std::string message) {
    return {ErrorCode::invalid_argument, std::move(message)};
}

} // namespace fraja::client
