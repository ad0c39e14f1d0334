#include "common/cli/option_card.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <utility>

namespace fraja::cli {
namespace {

/// CLI11 tells "N:UINT in [0 - 9]" for a range and "MODE:{auto,bar}" for choices.
void read_type_name(std::string_view text, OptionCard& card) {
    if (const auto set = text.find(":{"); set != std::string_view::npos && text.ends_with('}')) {
        std::string_view rest = text.substr(set + 2, text.size() - set - 3);
        for (std::size_t comma = 0; comma != std::string_view::npos;) {
            comma = rest.find(',');
            card.choices.emplace_back(rest.substr(0, comma));
            rest.remove_prefix(comma == std::string_view::npos ? rest.size() : comma + 1);
        }
        text = text.substr(0, set);
    } else if (const auto range = text.rfind(" in ["); range != std::string_view::npos) {
        const std::string_view bounds = text.substr(range + 5, text.size() - range - 6);
        const auto dash = bounds.find(" - ");
        card.range =
            std::string(bounds.substr(0, dash)) + " to " + std::string(bounds.substr(dash + 3));
        text = text.substr(0, text.rfind(':', range));
    }
    card.value = text;
}

} // namespace

const std::string& OptionCard::name() const {
    if (names.empty())
        return value;
    return *std::ranges::max_element(names, {}, &std::string::size);
}

std::string OptionCard::found_among(const std::vector<std::string>& typed) const {
    for (const std::string& word : typed)
        for (const std::string& name : names)
            if (name.size() == 2 ? word.starts_with(name) : word.substr(0, word.find('=')) == name)
                return name;
    return {};
}

std::string OptionCard::typed_name(const std::vector<std::string>& typed) const {
    const std::string found = found_among(typed);
    return found.empty() ? name() : found;
}

bool OptionCard::has_name(std::string_view wanted) const {
    return std::ranges::find(names, wanted) != names.end();
}

std::string OptionCard::allowed() const {
    return choices.empty() ? range : list_of(choices);
}

std::string OptionCard::shown_value() const {
    std::string shown;
    for (const std::string& choice : choices)
        shown += (shown.empty() ? "" : "|") + choice;
    return shown.empty() ? value : shown;
}

std::string OptionCard::terms() const {
    std::vector<std::string> parts;
    if (!range.empty())
        parts.push_back(range);
    if (!initial.empty())
        parts.push_back("default: " + initial);
    if (!excludes.empty())
        parts.push_back("not with " + list_of(excludes));
    if (!variable.empty())
        parts.push_back("or " + variable);
    std::string terms;
    for (const std::string& part : parts)
        terms += (terms.empty() ? "" : "; ") + part;
    return terms;
}

OptionCard card_of(const CLI::Option& option) {
    OptionCard card;
    for (const std::string& name : option.get_snames())
        card.names.push_back("-" + name);
    for (const std::string& name : option.get_lnames())
        card.names.push_back("--" + name);
    if (option.get_type_size() != 0)
        read_type_name(option.get_type_name(), card);
    card.initial = option.get_default_str();
    card.variable = option.get_envname();
    card.text = option.get_description();
    for (const CLI::Option* other : option.get_excludes())
        card.excludes.push_back(other->get_name());
    std::ranges::sort(card.excludes);
    card.required = option.get_required();
    return card;
}

std::vector<OptionCard> cards_of(const CLI::App& app) {
    std::vector<OptionCard> cards;
    for (const CLI::Option* option : app.get_options())
        cards.push_back(card_of(*option));
    std::ranges::stable_partition(cards, [](const OptionCard& card) { return card.names.empty(); });
    return cards;
}

std::vector<std::string> names_of(const std::vector<OptionCard>& cards) {
    std::vector<std::string> names;
    for (const OptionCard& card : cards)
        names.insert(names.end(), card.names.begin(), card.names.end());
    return names;
}

std::string list_of(const std::vector<std::string>& words) {
    std::string list;
    for (std::size_t i = 0; i < words.size(); ++i)
        list += (i == 0 ? "" : i + 1 == words.size() ? " or " : ", ") + words[i];
    return list;
}

} // namespace fraja::cli
