#include "client/preview/shrink.hpp"

#include "common/base/assert.hpp"
#include "common/image/quantise.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

namespace fraja::client {
namespace {

/// What one pixel covers of a row (or a column) of them: from `first` on, and how much of each.
struct Span {
    std::size_t first = 0;
    std::vector<float> weights; ///< their sum is 1
};

std::vector<Span> spans(std::uint32_t from, std::uint32_t to) {
    std::vector<Span> all(to);
    const double step = double{1} * from / to;
    for (std::uint32_t i = 0; i < to; ++i) {
        const double begin = i * step, end = std::min<double>(from, (i + 1) * step);
        const auto first = std::min(static_cast<std::uint32_t>(begin), from - 1);
        all[i].first = first;
        for (std::uint32_t p = first; p == first || (p < from && p < end); ++p)
            all[i].weights.push_back(static_cast<float>(
                std::max(0.0, std::min<double>(p + 1, end) - std::max<double>(p, begin)) /
                (end - begin)));
    }
    return all;
}

} // namespace

LevelsPicture shrink(const Film& film, Extent size) {
    const PixelRect& region = film.region();
    FRAJA_ASSERT(!region.empty() && size.pixel_count() > 0);
    const std::vector<Span> columns = spans(region.width, size.width);
    const std::vector<Span> rows = spans(region.height, size.height);
    LevelsPicture small{size, {}};
    small.rgb.reserve(3 * size.pixel_count());
    std::vector<float> sums;
    for (const Span& row : rows) {
        sums.assign(std::size_t{3} * size.width, 0.0F);
        for (std::size_t y = 0; y < row.weights.size(); ++y) {
            const auto line = film.pixels().subspan((row.first + y) * 3 * region.width,
                                                    std::size_t{3} * region.width);
            float* sum = sums.data();
            for (const Span& column : columns) {
                for (std::size_t x = 0; x < column.weights.size(); ++x)
                    for (std::size_t c = 0; c < 3; ++c)
                        sum[c] += row.weights[y] * column.weights[x] *
                                  static_cast<float>(quantise(line[3 * (column.first + x) + c]));
                sum += 3;
            }
        }
        for (const float sum : sums)
            small.rgb.push_back(static_cast<std::uint8_t>(std::min(255L, std::lround(sum))));
    }
    return small;
}

} // namespace fraja::client
