// fraja-watch's command line.
#pragma once

#include "client/options.hpp"
#include "client/preview/preview.hpp"
#include "client/watching.hpp"

#include <optional>
#include <string>
#include <vector>

namespace fraja::client {

/// --serve: the live page.
struct ServeOptions {
    std::string at; ///< ADDR:PORT; empty: the default
    bool allow_control = false;
    std::string token_file; ///< empty: a token is made where one is needed
};

struct WatchOptions {
    SharedOptions shared;
    std::optional<std::string> job; ///< none: the farm
    std::string output;             ///< empty: no picture is kept
    PictureEncoding encoding;       ///< of the output
    WatchUntil until;
    PreviewMode preview = PreviewMode::automatic;
    std::optional<std::string> tev;    ///< HOST:PORT, or HOST
    std::optional<ServeOptions> serve; ///< instead of all that; `job` is the one to show first
};

[[nodiscard]] Parsed<WatchOptions> parse_watch_options(std::vector<std::string> arguments);

/// "done", "first", "50%".
[[nodiscard]] std::optional<double> parse_until(std::string_view text);

} // namespace fraja::client
