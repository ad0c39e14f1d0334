#include "common/cli/manual.hpp"

#include "common/cli/option_card.hpp"

#include <CLI/CLI.hpp>
#include <string_view>

namespace fraja::cli {
namespace {

/// As it stands: scdoc takes these for its own.
std::string literal(std::string_view text) {
    std::string escaped;
    for (const char c : text) {
        if (std::string_view("\\*_#~[]|`<>+.").find(c) != std::string_view::npos)
            escaped += '\\';
        escaped += c;
    }
    return escaped;
}

std::string emphasised(std::string_view text, char mark) {
    return mark + literal(text) + mark;
}

/// "*-d*, *--depth* _N_", and what it is for below.
std::string entry(const OptionCard& card) {
    std::string head;
    for (const std::string& name : card.names)
        head += (head.empty() ? "" : ", ") + emphasised(name, '*');
    if (card.takes_value())
        head += (head.empty() ? "" : " ") + emphasised(card.shown_value(), '_');
    const std::string terms = card.terms();
    return head + "\n\t" + literal(card.text) + (terms.empty() ? "" : " (" + literal(terms) + ")") +
           ".\n\n";
}

/// "*prio* _JOB_ _N_", what it does, and its own options.
std::string command_entry(const CLI::App& command) {
    std::string head = emphasised(command.get_name(), '*'), options;
    for (const OptionCard& card : cards_of(command)) {
        if (card.names.empty())
            head += " " + emphasised(card.value, '_');
        else if (card.required)
            head += " " + emphasised(card.name(), '*') + " " + emphasised(card.value, '_');
        else if (card.name() != "--help")
            options += " " + emphasised(card.name(), '*') +
                       (card.takes_value() ? " " + emphasised(card.shown_value(), '_') : "") +
                       ": " + literal(card.text) + ".";
    }
    return head + "\n\t" + literal(command.get_description()) + "." + options + "\n\n";
}

} // namespace

std::string manual_sections(const CLI::App& app) {
    std::string commands, options;
    for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; }))
        commands += command_entry(*command);
    for (const OptionCard& card : cards_of(app))
        options += entry(card);
    return (commands.empty() ? "" : "# COMMANDS\n\n" + commands) + "# OPTIONS\n\n" + options;
}

} // namespace fraja::cli
