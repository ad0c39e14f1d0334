// The sharpness of highlights: an integer power. FORMAT.md, section 6.3.
#pragma once

#include <cstdint>

namespace fraja::reference {

/// max(0, cosine)^ns, with 0^0 = 1. By multiplication, so that its bits are the same on every
/// machine, which std::pow's are not. Raja's differ in the last ones; no level of its pictures
/// does.
///
/// A negative ns makes highlights grow without limit away from the mirror direction: they end at
/// highlight_max, and where Raja fails, at 0, there is none.
[[nodiscard]] double highlight(double cosine, std::int32_t ns);

inline constexpr double highlight_max = 1e100;

} // namespace fraja::reference
