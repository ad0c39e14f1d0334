#include "common/cli/mistakes.hpp"

#include "common/base/text.hpp"
#include "common/cli/option_card.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <optional>
#include <string_view>

namespace fraja::cli {
namespace {

/// " (did you mean '--priority'?)", or nothing: a name that was not finished, or a slip of the
/// fingers.
std::string meant(const std::string& word, const std::vector<std::string>& names) {
    const std::vector<std::string_view> views(names.begin(), names.end());
    return did_you_mean(meant_name(word, views));
}

std::vector<std::string> commands_of(const CLI::App& app) {
    std::vector<std::string> names;
    for (const CLI::App* sub : app.get_subcommands([](const CLI::App*) { return true; }))
        names.push_back(sub->get_name());
    return names;
}

/// Of the app and of the command that was typed.
std::vector<std::string> all_names(const CLI::App& app) {
    std::vector<std::string> names = names_of(cards_of(app));
    for (const CLI::App* sub : app.get_subcommands())
        std::ranges::copy(names_of(cards_of(*sub)), std::back_inserter(names));
    return names;
}

/// What nobody asked for.
std::optional<std::string> of_extras(const CLI::App& app) {
    const std::vector<std::string> extras = app.remaining(true);
    const auto dashed = std::ranges::find_if(
        extras, [](const std::string& word) { return word.size() > 1 && word[0] == '-'; });
    if (dashed != extras.end()) {
        const std::string name = dashed->substr(0, dashed->find('='));
        return "there is no option '" + name + "'" + meant(name, all_names(app));
    }
    if (extras.empty())
        return std::nullopt;
    if (app.get_subcommands().empty() && !commands_of(app).empty())
        return "there is no command '" + extras[0] + "'" + meant(extras[0], commands_of(app));
    return "'" + extras[0] + "' is one argument too many";
}

/// The option that the error is about: CLI11 says its name at the start, or after a colon.
const CLI::Option* option_of(const CLI::App& app, std::string_view what) {
    for (const std::string_view lead : {"", "Could not convert: "}) {
        if (!what.starts_with(lead))
            continue;
        std::string_view name = what.substr(lead.size());
        name = name.substr(0, name.find_first_of(": "));
        if (const auto* option = app.get_option_no_throw(std::string(name)))
            return option;
        for (const CLI::App* sub : app.get_subcommands())
            if (const auto* option = sub->get_option_no_throw(std::string(name)))
                return option;
    }
    return nullptr;
}

bool was_typed(const OptionCard& card, const std::vector<std::string>& typed) {
    return card.names.empty() || !card.found_among(typed).empty();
}

/// "--depth -1", or "FRAJA_DEPTH=-1" where that said it. Of several values the one that CLI11
/// complains about.
std::string as_given(const OptionCard& card, const CLI::Option& option, std::string_view what,
                     const std::vector<std::string>& typed) {
    std::string value;
    for (const std::string& result : option.results())
        if (value.empty() || what.find(" " + result + " ") != std::string_view::npos)
            value = result;
    const std::string shown(clipped(value, 200));
    if (!was_typed(card, typed) && !card.variable.empty())
        return card.variable + "=" + shown + " in the environment";
    return card.names.empty() ? card.value + " '" + shown + "'"
                              : card.typed_name(typed) + " " + shown;
}

/// "fraja-ctl get JOB -o FILE": what it cannot do without.
std::string usage_of(const CLI::App& app) {
    const CLI::App* active = &app;
    std::string usage = app.get_name();
    for (const CLI::App* command : app.get_subcommands()) {
        active = command;
        usage += " " + command->get_name();
    }
    for (const OptionCard& card : cards_of(*active))
        if (card.names.empty())
            usage += " " + card.value;
        else if (card.required)
            usage += " " + card.names.front() + " " + card.value;
    return usage;
}

std::string of_value(const OptionCard& card, const CLI::Option& option, std::string_view what,
                     const std::vector<std::string>& typed) {
    const std::string given = as_given(card, option, what, typed) + ": ";
    if (!card.choices.empty())
        return given + card.allowed() + meant(option.results().back(), card.choices);
    if (!card.range.empty())
        return given + "a number is needed, " + card.range;
    if (!card.takes_value())
        return card.typed_name(typed) + " takes no value";
    return given + "cannot be read as " + card.value;
}

/// Whether "--output=" was typed, where CLI11 would take the next word for the value; or nothing
/// after the name, as of an option that may stand alone it says the same where it does.
bool is_cut_off(const OptionCard& card, const std::vector<std::string>& typed) {
    std::string_view before;
    for (const std::string_view word : typed) {
        if (word == "--")
            return false;
        const bool ends_so = word.starts_with("--") && word.find('=') + 1 == word.size();
        if ((ends_so && card.has_name(word.substr(0, word.size() - 1))) ||
            (word.empty() && card.has_name(before)))
            return true;
        before = word;
    }
    return false;
}

} // namespace

std::optional<std::string> empty_value_in(const CLI::App& app,
                                          const std::vector<std::string>& typed) {
    std::vector<const CLI::App*> apps{&app};
    std::ranges::copy(app.get_subcommands(), std::back_inserter(apps));
    for (const CLI::App* one : apps)
        for (const CLI::Option* option : one->get_options()) {
            const OptionCard card = card_of(*option);
            const bool may_stand_alone = option->get_items_expected_min() == 0;
            if (!card.names.empty() && card.takes_value() &&
                (is_cut_off(card, typed) ||
                 (!may_stand_alone && std::ranges::count(option->results(), "") > 0)))
                return card.typed_name(typed) + " '': empty, and " + card.shown_value() +
                       " is needed; is a variable not set?";
        }
    return std::nullopt;
}

std::string mistake(const CLI::App& app, const CLI::ParseError& error,
                    const std::vector<std::string>& typed) {
    if (const auto extra = of_extras(app))
        return *extra;
    const std::string what = error.what();
    const auto is = [&](const char* name) { return error.get_name() == name; };
    const CLI::Option* option = option_of(app, what);
    if (is("RequiredError") && !option)
        return "a command is needed: " + list_of(commands_of(app));
    if (!option)
        return what;
    const OptionCard card = card_of(*option);
    if (is("RequiredError"))
        return card.name() + " is missing: " + usage_of(app);
    if (is("ArgumentMismatch")) {
        if (what.find("At Most") != std::string::npos)
            return card.typed_name(typed) + " is given twice";
        return card.typed_name(typed) +
               (card.takes_value() ? " needs a value: " + card.value : " takes no value");
    }
    const std::string other = what.substr(what.rfind(' ') + 1);
    if (is("ExcludesError"))
        return card.name() + " and " + other + " exclude each other: give one of them";
    if (is("RequiresError"))
        return card.name() + " is of no use without " + other;
    return of_value(card, *option, what, typed);
}

} // namespace fraja::cli
