// Whole pictures under stress: the same scene at other sizes and places, optics that must cancel
// out, scenes of absurd numbers.
#pragma once

#include "common/base/pixel_rect.hpp"

#include <cstdint>
#include <string>
#include <vector>

namespace fraja::stress {

/// What was measured, and what it may be at most.
struct Figure {
    std::string name;
    double value, mark;
};

/// `small` for pictures whose rays are many, `large` for the others.
[[nodiscard]] std::vector<Figure> picture_figures(Extent small, Extent large,
                                                  std::uint64_t absurd_scenes);

} // namespace fraja::stress
