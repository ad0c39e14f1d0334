// Where a program's options come from: the command line, where some have two names, the
// environment, or a settings file.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace CLI {
class App;
class Option;
} // namespace CLI

namespace fraja::cli {

/// Two options, by their long names, of which a program takes one.
struct Exclusion {
    std::string option, other;
};

class Origins {
public:
    /// `exclusions`: beside those that the CLI::App is told of. Typed together, they are refused by
    /// the program itself, which has more to say of them.
    explicit Origins(std::vector<Exclusion> exclusions = {});

    /// What was typed, of these options; what they have beside that, the environment gave.
    void note_typed(const CLI::App& app, const std::vector<std::string>& typed);
    /// A settings file gave that option: "/etc/fraja/config.toml:3:1".
    void note_setting(const CLI::Option& option, std::string place);

    /// The given option that this one cannot stand beside; null: there is none. A flag that is
    /// false excludes nothing.
    [[nodiscard]] const CLI::Option* excluder_of(const CLI::App& app,
                                                 const CLI::Option& option) const;
    /// Whether that option, "--like-this", was typed, by whichever of its names.
    [[nodiscard]] bool is_typed(const std::string& option) const;
    /// Whether it comes from a settings file.
    [[nodiscard]] bool is_setting(const std::string& option) const;
    /// Where; empty: it does not.
    [[nodiscard]] std::string place_of(const std::string& option) const;
    /// A mistake as the program tells it, "--size 640: ...": with the name that was typed, and the
    /// place of each option in it that stands in a file, or the variable that gave it.
    [[nodiscard]] std::string blame(std::string message) const;

private:
    std::vector<Exclusion> exclusions_;
    std::map<std::string, std::string> typed_;     ///< long name -> the one that was typed
    std::map<std::string, std::string> places_;    ///< long name -> where it stands
    std::map<std::string, std::string> variables_; ///< long name -> what gave it
};

} // namespace fraja::cli
