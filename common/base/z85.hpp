// Z85 (RFC 32): bytes as printable characters, as keys are written.
#pragma once

#include <string_view>

namespace fraja {

/// All its characters are; what stands for bytes has further rules.
[[nodiscard]] constexpr bool is_of_z85(std::string_view text) {
    constexpr std::string_view alphabet =
        "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ.-:+=^!/*?&<>()[]{}@%$#";
    return text.find_first_not_of(alphabet) == std::string_view::npos;
}

} // namespace fraja
