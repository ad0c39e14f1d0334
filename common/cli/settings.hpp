// Options that are not typed, from settings files.
#pragma once

#include "common/base/result.hpp"
#include "common/cli/origins.hpp"

#include <filesystem>
#include <vector>

namespace fraja::cli {

/// $XDG_CONFIG_HOME/fraja/config.toml (or that in ~/.config), and then /etc/fraja/config.toml.
[[nodiscard]] std::vector<std::filesystem::path> settings_files();

/// Gives the app, which has read its command line, what the files say, in their order: of each
/// option --like-this that was neither typed nor in its environment variable, is configurable(),
/// and not excluded by one that was given; and notes them in `origins`. Errors: as read_settings();
/// a value that the option refuses; two options of one file that exclude each other.
[[nodiscard]] Result<void>
take_settings(CLI::App& app, const std::vector<std::filesystem::path>& files, Origins& origins);

} // namespace fraja::cli
