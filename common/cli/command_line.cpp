#include "common/cli/command_line.hpp"

#include "common/base/text.hpp"
#include "common/cli/settings_file.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <utility>

namespace fraja::cli {
namespace {

constexpr int usage_code = 2;

/// The options that may stand in a file.
std::vector<CLI::Option*> named_options(CLI::App& app) {
    return app.get_options([&](const CLI::Option* option) {
        return !option->get_lnames().empty() && option != app.get_help_ptr() &&
               option != app.get_version_ptr();
    });
}

const std::string& name_of(const CLI::Option& option) {
    return option.get_lnames().front();
}

bool is_excluded(const CLI::Option& option) {
    return std::ranges::any_of(option.get_excludes(),
                               [](const CLI::Option* other) { return !other->empty(); });
}

/// As if it had been typed.
Result<void> give(CLI::Option& option, const std::vector<std::string>& values,
                  const std::string& place) {
    if (!option.empty() || !option.get_configurable() || is_excluded(option))
        return {};
    try {
        for (const std::string& value : values)
            option.add_result(value);
        if (!values.empty())
            option.run_callback();
        return {};
    } catch (const CLI::Error& e) {
        return Error{ErrorCode::invalid_argument, place + ": " + e.what()};
    }
}

Result<void> take_files(CLI::App& app, const std::vector<std::filesystem::path>& files) {
    std::vector<std::string> names;
    for (const CLI::Option* option : named_options(app))
        names.push_back(name_of(*option));
    for (const auto& file : files) {
        const auto settings = read_settings(file, app.get_name(), names);
        if (!settings)
            return settings.error();
        for (const Setting& setting : *settings) {
            CLI::Option* option = app.get_option("--" + setting.option);
            if (const auto given = give(*option, setting.values, setting.place); !given)
                return given.error();
        }
    }
    return {};
}

} // namespace

std::vector<std::filesystem::path> settings_files() {
    const auto folder = [](const char* variable) {
        const char* value = std::getenv(variable);
        return value && *value ? std::filesystem::path(value) : std::filesystem::path();
    };
    std::vector<std::filesystem::path> files;
    // The XDG specification passes over a path that is not absolute.
    if (const auto config = folder("XDG_CONFIG_HOME"); config.is_absolute())
        files.push_back(config / "fraja/config.toml");
    else if (const auto home = folder("HOME"); home.is_absolute())
        files.push_back(home / ".config/fraja/config.toml");
    files.emplace_back("/etc/fraja/config.toml");
    return files;
}

std::optional<EarlyExit> parse(CLI::App& app, std::vector<std::string> arguments,
                               const std::vector<std::filesystem::path>& files) {
    std::ranges::reverse(arguments); // as CLI11 wants them
    try {
        app.parse(std::move(arguments));
    } catch (const CLI::CallForVersion& e) {
        return EarlyExit{0, std::string(e.what()) + "\n"};
    } catch (const CLI::CallForHelp&) {
        return EarlyExit{0, app.help()};
    } catch (const CLI::CallForAllHelp&) {
        return EarlyExit{0, app.help("", CLI::AppFormatMode::All)};
    } catch (const CLI::ParseError& e) {
        return usage_error(app.get_name(), e.what());
    }
    if (const auto taken = take_files(app, files); !taken)
        return usage_error(app.get_name(), taken.error().message);
    return std::nullopt;
}

EarlyExit usage_error(std::string_view program, std::string_view message) {
    const std::string name(program);
    return {usage_code, name + ": error: " + printable(message) + " (" + name + " --help)\n"};
}

int leave(const EarlyExit& exit) {
    std::fputs(exit.text.c_str(), exit.code == 0 ? stdout : stderr);
    return exit.code;
}

std::vector<std::string> arguments_of(int argc, char** argv) {
    return {argv + std::min(argc, 1), argv + argc};
}

} // namespace fraja::cli
