// What people need to know of an option, in parts. CLI11 has some of it in words of its own alone.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace CLI {
class App;
class Option;
} // namespace CLI

namespace fraja::cli {

struct OptionCard {
    std::vector<std::string> names;    ///< "-d", "--depth"; none: it is told by its place
    std::string value;                 ///< what it takes, "N", "WxH"; empty: nothing
    std::vector<std::string> choices;  ///< the values there are; empty: see `range`
    std::string range;                 ///< "0 to 1000000"; empty: see `text`
    std::string initial;               ///< what holds where it is not given; empty: see `text`
    std::string variable;              ///< of the environment that gives it too
    std::vector<std::string> excludes; ///< names of others
    std::string text;                  ///< what it is for
    bool required = false;

    /// The longest of the names, or the value.
    [[nodiscard]] const std::string& name() const;
    /// The name of them that is among `typed`, as a word, with a value behind it or, of a short
    /// one, grown together with it; where none is, empty.
    [[nodiscard]] std::string found_among(const std::vector<std::string>& typed) const;
    /// That, or else name().
    [[nodiscard]] std::string typed_name(const std::vector<std::string>& typed) const;
    [[nodiscard]] bool takes_value() const { return !value.empty(); }
    [[nodiscard]] bool has_name(std::string_view name) const;
    /// "0 to 1000000", "box or tent"; empty: neither.
    [[nodiscard]] std::string allowed() const;
    /// "N", "box|tent".
    [[nodiscard]] std::string shown_value() const;
    /// "0 to 256; default: 0; not with --spp; or FRAJA_AA"; may be empty.
    [[nodiscard]] std::string terms() const;
};

[[nodiscard]] OptionCard card_of(const CLI::Option& option);
/// Of the app's own options in their order, those that are told by their place first.
[[nodiscard]] std::vector<OptionCard> cards_of(const CLI::App& app);

/// Every name of theirs.
[[nodiscard]] std::vector<std::string> names_of(const std::vector<OptionCard>& cards);

/// "a, b or c".
[[nodiscard]] std::string list_of(const std::vector<std::string>& words);

} // namespace fraja::cli
