// The words of a transcript's command: what it is, of whom or what, then NAME=VALUE in any order.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace fraja::broker {

/// Thrown where a command is carried out, and caught where its line is known.
struct BadCommand : std::runtime_error {
    using std::runtime_error::runtime_error;
};

class Words {
public:
    explicit Words(std::string_view line);

    /// The next word without a name. BadCommand where there is none; `what` says what it should be.
    std::string next(std::string_view what);
    /// Whether that is the next one; then it is taken.
    bool next_is(std::string_view word);
    /// All that are left, as they are.
    std::string rest();

    [[nodiscard]] bool has(std::string_view name) const;
    /// BadCommand where the name is not given, or not with a number.
    std::string text(std::string_view name);
    std::uint32_t number(std::string_view name);
    std::uint32_t number(std::string_view name, std::uint32_t otherwise);

    /// BadCommand where there is something that nobody has asked for.
    void end() const;

private:
    std::vector<std::string> words_; ///< that nobody has asked for yet
};

} // namespace fraja::broker
