#include "common/service/log_options.hpp"

#include <CLI/CLI.hpp>

namespace fraja::service {

LogLevel LogOptions::least() const {
    return level == "error"                        ? LogLevel::error
           : level == "warning" || level == "warn" ? LogLevel::warning
           : level == "info"                       ? LogLevel::info
                                                   : LogLevel::debug;
}

ColorChoice LogOptions::color_choice() const {
    return color == "always"  ? ColorChoice::always
           : color == "never" ? ColorChoice::never
                              : ColorChoice::automatic;
}

void add_log_options(CLI::App& app, LogOptions& options) {
    app.add_option("--log-level", options.level, "How much is said on stderr")
        ->envname("FRAJA_LOG_LEVEL")
        ->capture_default_str()
        ->check(CLI::IsMember({"trace", "debug", "info", "warning", "warn", "error"}))
        ->type_name("LEVEL");
    app.add_option("--log-format", options.format,
                   "What is said there: text, or json, an object on each line")
        ->envname("FRAJA_LOG_FORMAT")
        ->capture_default_str()
        ->check(CLI::IsMember({"text", "json"}))
        ->type_name("FORMAT");
    app.add_option("--color", options.color, "Whether it is coloured; NO_COLOR is honoured")
        ->envname("FRAJA_COLOR")
        ->capture_default_str()
        ->check(CLI::IsMember({"auto", "always", "never"}))
        ->type_name("WHEN");
}

} // namespace fraja::service
