// How a program is told what to say of its doings, and how.
#pragma once

#include "common/base/log_line.hpp"
#include "common/service/color.hpp"

#include <string>

namespace CLI {
class App;
}

namespace fraja::service {

/// As people type them; add_log_options() sees to it that they are known words.
struct LogOptions {
    std::string level = "info", format = "text", color = "auto";

    /// Of what is said at least.
    [[nodiscard]] LogLevel least() const;
    [[nodiscard]] ColorChoice color_choice() const;
    [[nodiscard]] bool as_json() const { return format == "json"; }
};

/// --log-level, --log-format and --color, which every program has.
void add_log_options(CLI::App& app, LogOptions& options);

} // namespace fraja::service
