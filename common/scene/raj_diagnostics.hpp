// Where in a .raj text something stands, and what is said about it.
#pragma once

#include "common/base/result.hpp"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace fraja::raj {

struct Place {
    std::uint32_t offset = 0; ///< bytes before it
    std::uint32_t line = 1;   ///< from 1
};

/// Collects the first fault and some warnings, each opening with `file:line:column: `.
class Diagnostics {
public:
    static constexpr std::size_t warnings_max = 20; ///< the rest are only counted

    /// Both must outlive this.
    Diagnostics(std::string_view text, std::string_view file_name)
        : text_(text), file_name_(file_name) {}

    /// Notes the fault if it is the first. Always false, for `return diagnostics.refuse(...)`.
    bool refuse(Place place, std::string_view message, ErrorCode code = ErrorCode::invalid_scene);
    /// The same for a limit of RajLimits: its name, its value, and what it counts.
    bool refuse_limit(Place place, std::string_view name, std::uint64_t limit,
                      std::string_view counts);
    void warn(Place place, std::string_view message);

    [[nodiscard]] const std::optional<Error>& error() const { return error_; }
    [[nodiscard]] std::vector<std::string> take_warnings();

private:
    [[nodiscard]] std::string located(Place place, std::string_view message) const;

    std::string_view text_, file_name_;
    std::optional<Error> error_;
    std::vector<std::string> warnings_;
    std::size_t warnings_unsaid_ = 0;
};

/// `text` in quotes for a message; cut when it is long, and without bytes that no terminal shows.
[[nodiscard]] std::string quoted(std::string_view text);

} // namespace fraja::raj
