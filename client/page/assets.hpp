// The page's files, which the build puts into the program.
#pragma once

#include <span>
#include <string_view>

namespace fraja::client {

struct Asset {
    std::string_view name, type, text;
};

[[nodiscard]] std::span<const Asset> page_assets();

} // namespace fraja::client
