#include "common/cli/settings.hpp"

#include "common/cli/mistakes.hpp"
#include "common/cli/option_card.hpp"
#include "common/cli/settings_file.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdlib>
#include <string>

namespace fraja::cli {
namespace {

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

/// As if it had been typed.
Result<void> give(const CLI::App& app, const std::filesystem::path& file, CLI::Option& option,
                  const Setting& setting, Origins& origins) {
    if (!option.empty() || !option.get_configurable())
        return {};
    if (const CLI::Option* other = origins.excluder_of(app, option)) {
        const std::string place = origins.place_of("--" + name_of(*other));
        if (!place.starts_with(file.string() + ":"))
            return {}; // what is typed, and an earlier file, go first
        return Error{ErrorCode::invalid_argument, setting.place + ": " + setting.option + " and " +
                                                      name_of(*other) + " (" + place +
                                                      ") exclude each other: give one of them"};
    }
    if (const OptionCard card = card_of(option);
        card.takes_value() && std::ranges::count(setting.values, "") > 0)
        return Error{ErrorCode::invalid_argument, setting.place + ": " + setting.option +
                                                      " = '': empty, and " + card.value +
                                                      " is needed; leave it out, or say it"};
    try {
        for (const std::string& value : setting.values)
            option.add_result(value);
        if (!setting.values.empty())
            option.run_callback();
        origins.note_setting(option, setting.place);
        return {};
    } catch (const CLI::ParseError& e) {
        return Error{ErrorCode::invalid_argument,
                     setting.place + ": " + mistake(app, e, {"--" + setting.option})};
    }
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

Result<void> take_settings(CLI::App& app, const std::vector<std::filesystem::path>& files,
                           Origins& origins) {
    std::vector<std::string> names;
    for (const CLI::Option* option : named_options(app))
        names.push_back(name_of(*option));
    for (const auto& file : files) {
        const auto settings = read_settings(file, app.get_name(), names);
        if (!settings)
            return settings.error();
        for (const Setting& setting : *settings) {
            CLI::Option& option = *app.get_option("--" + setting.option);
            if (const auto given = give(app, file, option, setting, origins); !given)
                return given.error();
        }
    }
    return {};
}

} // namespace fraja::cli
