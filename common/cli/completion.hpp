// What a shell may offer behind the words that are typed so far, from the program's own description
// of its command line; and the scripts by which bash, zsh and fish ask for it.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace CLI {
class App;
}

namespace fraja::cli {

struct Candidate {
    std::string word;
    std::string what; ///< a few words beside it, where the shell shows such; may be empty
};

/// Names for a value that only the program knows how to find, as "JOB", that begin with `begun`.
/// Asked while somebody waits for a key: soon, or not at all.
using NameSource =
    std::function<std::vector<Candidate>(std::string_view value, std::string_view begun)>;

/// A line for each candidate: the word, a tab, what it is. Or, where files are wanted, one line
/// ":files", ":files raj" (those that end so) or ":directories". `words` are those behind the
/// program's name; the last is the one that is being typed, perhaps empty. Before `names` is asked,
/// the app has read what stands before.
[[nodiscard]] std::string completions(CLI::App& app, std::vector<std::string> words,
                                      const NameSource& names);

/// The script for that shell ("bash", "zsh", "fish"), which completes these programs by asking
/// them: PROGRAM --complete WORD...
[[nodiscard]] std::optional<std::string> completion_script(std::string_view shell,
                                                           std::span<const std::string> programs);

} // namespace fraja::cli
