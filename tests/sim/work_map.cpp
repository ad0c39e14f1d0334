#include "tests/sim/work_map.hpp"

#include "common/base/assert.hpp"

#include <algorithm>
#include <cstddef>

namespace fraja::sim {
namespace {

/// Where a coordinate lies among units: the whole ones before it, and the part of the next.
struct Along {
    std::uint32_t whole;
    double part;
};

Along along(std::uint32_t at, std::uint32_t side, std::uint32_t length) {
    const std::uint32_t whole = at / side;
    const std::uint32_t unit = std::min(side, length - std::min(length, whole * side));
    return {whole, unit > 0 ? static_cast<double>(at - whole * side) / unit : 0.0};
}

} // namespace

WorkMap::WorkMap(Extent size, std::uint32_t unit_side, const std::vector<double>& rays)
    : size_(size), side_(unit_side), columns_((size.width + unit_side - 1) / unit_side),
      rows_((size.height + unit_side - 1) / unit_side),
      sums_((std::size_t{columns_} + 1) * (rows_ + 1)) {
    FRAJA_ASSERT(rays.size() == std::size_t{columns_} * rows_);
    const std::size_t stride = std::size_t{columns_} + 1;
    for (std::size_t r = 0; r < rows_; ++r) {
        double row = 0;
        for (std::size_t c = 0; c < columns_; ++c) {
            row += rays[r * columns_ + c];
            sums_[(r + 1) * stride + c + 1] = sums_[r * stride + c + 1] + row;
        }
    }
}

double WorkMap::sum_before(std::uint32_t x, std::uint32_t y) const {
    const Along h = along(x, side_, size_.width), v = along(y, side_, size_.height);
    const std::size_t stride = std::size_t{columns_} + 1;
    const auto corner = [&](std::uint32_t column, std::uint32_t row) {
        return sums_[std::min(row, rows_) * stride + std::min(column, columns_)];
    };
    const double upper =
        (1 - h.part) * corner(h.whole, v.whole) + h.part * corner(h.whole + 1, v.whole);
    if (v.part == 0)
        return upper;
    const double lower =
        (1 - h.part) * corner(h.whole, v.whole + 1) + h.part * corner(h.whole + 1, v.whole + 1);
    return (1 - v.part) * upper + v.part * lower;
}

double WorkMap::rays(const PixelRect& r) const {
    FRAJA_ASSERT(r.inside(size_));
    return std::max(0.0, sum_before(r.x + r.width, r.y + r.height) -
                             sum_before(r.x, r.y + r.height) - sum_before(r.x + r.width, r.y) +
                             sum_before(r.x, r.y));
}

} // namespace fraja::sim
