// Whether what a program says is coloured: one answer for all of it.
#pragma once

#include <cstdint>

namespace fraja::service {

enum class ColorChoice : std::uint8_t { automatic, always, never };

/// Of what goes to the file behind `fd`. Where it is automatic: on a terminal, but a dumb one
/// ($TERM), unless $NO_COLOR is set to anything.
[[nodiscard]] bool wants_color(ColorChoice choice, int fd);

} // namespace fraja::service
