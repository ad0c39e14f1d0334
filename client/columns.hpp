// Columns: how wide text is on a terminal. Names are anybody's, and may be Chinese.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace fraja::client {

/// Of UTF-8 that is printable(); what the system does not know is one column for each code point.
[[nodiscard]] std::size_t columns_of(std::string_view text);
/// As many whole characters from the beginning as have room.
[[nodiscard]] std::string_view first_columns(std::string_view text, std::size_t columns_max);
/// The same, made printable; what is left out shows as "...", within the room.
[[nodiscard]] std::string shortened(std::string_view text, std::size_t columns_max);

} // namespace fraja::client
