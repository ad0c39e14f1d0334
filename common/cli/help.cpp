#include "common/cli/help.hpp"

#include "common/cli/option_card.hpp"

#include <CLI/CLI.hpp>
#include <cstddef>
#include <memory>
#include <string>
#include <string_view>

namespace fraja::cli {
namespace {

constexpr std::size_t name_column = 30, line_letters_max = 100;

/// With breaks between words; CLI11 puts the lines below one another.
std::string wrapped(std::string_view text, std::size_t letters_max) {
    std::string lines;
    while (text.size() > letters_max) {
        const std::size_t blank = text.rfind(' ', letters_max);
        if (blank == std::string_view::npos)
            break;
        lines += std::string(text.substr(0, blank)) + '\n';
        text.remove_prefix(blank + 1);
    }
    return lines + std::string(text);
}

class HouseFormatter final : public CLI::Formatter {
public:
    HouseFormatter() {
        column_width(name_column);
        label("Positionals", "Arguments");
    }

    std::string make_option_opts(const CLI::Option* option) const override {
        const OptionCard card = card_of(*option);
        return card.takes_value() && !card.names.empty() ? " " + card.shown_value() : "";
    }
    std::string make_option_name(const CLI::Option* option, bool by_place) const override {
        return by_place ? card_of(*option).value : CLI::Formatter::make_option_name(option, false);
    }
    std::string make_option_desc(const CLI::Option* option) const override {
        const OptionCard card = card_of(*option);
        const std::string terms = card.terms();
        return wrapped(card.text + (terms.empty() ? "" : " (" + terms + ")"),
                       line_letters_max - name_column);
    }
    std::string make_option_usage(const CLI::Option* option) const override {
        const OptionCard card = card_of(*option);
        return card.required ? card.value : "[" + card.value + "]";
    }
};

} // namespace

void use_house_help(CLI::App& app) {
    const auto formatter = std::make_shared<HouseFormatter>();
    app.formatter(formatter);
    for (CLI::App* command : app.get_subcommands([](CLI::App*) { return true; }))
        command->formatter(formatter)->group("Commands");
}

} // namespace fraja::cli
