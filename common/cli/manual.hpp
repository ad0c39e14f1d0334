// The part of a manual page that a program knows best.
#pragma once

#include <string>

namespace CLI {
class App;
}

namespace fraja::cli {

/// The sections COMMANDS, where there are commands, and OPTIONS, in scdoc's language.
[[nodiscard]] std::string manual_sections(const CLI::App& app);

} // namespace fraja::cli
