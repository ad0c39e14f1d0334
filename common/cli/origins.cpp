#include "common/cli/origins.hpp"

#include "common/cli/option_card.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <utility>

namespace fraja::cli {
namespace {

bool excludes_others(const CLI::Option& option) {
    const bool is_flag = option.get_expected_min() == 0;
    return !option.empty() && !(is_flag && option.results().back() == "false");
}

/// Where the option's whole name stands in the text.
std::size_t place_of_name(std::string_view text, std::string_view name) {
    std::size_t at = text.find(name);
    while (at != std::string_view::npos && at + name.size() < text.size() &&
           std::string_view(" :,.=").find(text[at + name.size()]) == std::string_view::npos)
        at = text.find(name, at + 1);
    return at;
}

} // namespace

Origins::Origins(std::vector<Exclusion> exclusions) : exclusions_(std::move(exclusions)) {}

void Origins::note_typed(const CLI::App& app, const std::vector<std::string>& typed) {
    for (const OptionCard& card : cards_of(app)) {
        if (card.names.empty())
            continue;
        if (std::string name = card.found_among(typed); !name.empty())
            typed_[card.name()] = std::move(name);
        else if (!card.variable.empty() && !app.get_option(card.name())->empty())
            variables_[card.name()] = card.variable + " in the environment";
    }
}

void Origins::note_setting(const CLI::Option& option, std::string place) {
    places_.emplace(card_of(option).name(), std::move(place));
}

const CLI::Option* Origins::excluder_of(const CLI::App& app, const CLI::Option& option) const {
    for (const CLI::Option* other : option.get_excludes())
        if (excludes_others(*other))
            return other;
    const std::string name = card_of(option).name();
    for (const Exclusion& e : exclusions_) {
        const std::string& other = e.option == name ? e.other : e.option;
        if ((e.option == name || e.other == name) && excludes_others(*app.get_option(other)))
            return app.get_option(other);
    }
    return nullptr;
}

bool Origins::is_typed(const std::string& option) const {
    return typed_.contains(option);
}

bool Origins::is_setting(const std::string& option) const {
    return places_.contains(option);
}

std::string Origins::place_of(const std::string& option) const {
    const auto found = places_.find(option);
    return found == places_.end() ? std::string() : found->second;
}

std::string Origins::blame(std::string message) const {
    std::string opening, ending;
    for (const auto* origins : {&places_, &variables_})
        for (const auto& [name, place] : *origins)
            if (const std::size_t at = place_of_name(message, name); at == 0)
                opening = place + ": ";
            else if (at != std::string::npos)
                ending += " (" + name + ": " + place + ")";
    for (const auto& [name, as_typed] : typed_)
        if (as_typed != name && place_of_name(message, name) == 0)
            message.replace(0, name.size(), as_typed);
    return opening + message + ending;
}

} // namespace fraja::cli
