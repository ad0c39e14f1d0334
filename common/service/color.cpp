#include "common/service/color.hpp"

#include <cstdlib>
#include <string_view>
#include <unistd.h>

namespace fraja::service {
namespace {

std::string_view from_environment(const char* name) {
    const char* const value = std::getenv(name);
    return value ? value : "";
}

} // namespace

bool wants_color(ColorChoice choice, int fd) {
    if (choice != ColorChoice::automatic)
        return choice == ColorChoice::always;
    return isatty(fd) == 1 && from_environment("NO_COLOR").empty() &&
           from_environment("TERM") != "dumb";
}

} // namespace fraja::service
