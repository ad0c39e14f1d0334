#include "common/cli/parse.hpp"

#include "common/base/text.hpp"
#include "common/cli/help.hpp"
#include "common/cli/manual.hpp"
#include "common/cli/mistakes.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <utility>

namespace fraja::cli {

namespace {

/// To shells and to the build.
std::optional<std::string> answer(CLI::App& app, const std::vector<std::string>& arguments,
                                  Origins& origins, const NameSource& names,
                                  const std::vector<std::filesystem::path>& files) {
    if (arguments.empty())
        return std::nullopt;
    if (arguments[0] == "--complete")
        return completions(app, {arguments.begin() + 1, arguments.end()}, names);
    if (arguments[0] == "--completion" && arguments.size() == 2)
        return completion_script(arguments[1], std::vector{app.get_name()});
    if (arguments[0] == "--manual" && arguments.size() == 1)
        return manual_sections(app);
    if (arguments[0] == "--check-settings" && arguments.size() == 1) {
        const auto taken = take_settings(app, files, origins);
        return taken ? std::string() : printable(taken.error().message) + "\n";
    }
    return std::nullopt;
}

} // namespace

std::optional<EarlyExit> parse(CLI::App& app, std::vector<std::string> arguments, Origins& origins,
                               const NameSource& names,
                               const std::vector<std::filesystem::path>& files) {
    use_house_help(app);
    if (auto told = answer(app, arguments, origins, names, files))
        return EarlyExit{0, *std::move(told)};
    const std::vector<std::string> typed = arguments;
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
        const auto empty = empty_value_in(app, typed);
        return usage_error(app.get_name(), empty ? *empty : mistake(app, e, typed));
    }
    if (const auto empty = empty_value_in(app, typed))
        return usage_error(app.get_name(), *empty);
    origins.note_typed(app, typed);
    if (const auto taken = take_settings(app, files, origins); !taken)
        return usage_error(app.get_name(), taken.error().message);
    return std::nullopt;
}

EarlyExit usage_error(std::string_view program, std::string_view message) {
    const std::string name(program);
    return {2, name + ": error: " + printable(message) + " (" + name + " --help)\n"};
}

EarlyExit failure(std::string_view program, std::string_view message) {
    return {2, std::string(program) + ": error: " + printable(message) + "\n"};
}

EarlyExit failure(std::string_view program, const Error& error) {
    constexpr int start_again = 75; // EX_TEMPFAIL of sysexits.h
    EarlyExit exit = failure(program, error.message);
    if (error.code == ErrorCode::in_use)
        exit.code = start_again;
    return exit;
}

int leave(const EarlyExit& exit) {
    std::fputs(exit.text.c_str(), exit.code == 0 ? stdout : stderr);
    return exit.code;
}

std::vector<std::string> arguments_of(int argc, char** argv) {
    return {argv + std::min(argc, 1), argv + argc};
}

} // namespace fraja::cli
