#include "common/render/reference/highlight.hpp"

#include "tests/support/seeds.hpp"

#include <cmath>
#include <doctest/doctest.h>
#include <initializer_list>
#include <limits>

namespace fraja::reference {
namespace {

TEST_CASE("a highlight is a power of the cosine, and none behind the mirror direction") {
    struct Row {
        double cosine;
        int ns;
        double want;
    };
    for (const Row& row :
         {Row{0.5, 3, 0.125}, Row{0.5, 0, 1}, Row{0, 0, 1}, Row{-0.5, 0, 1}, Row{-0.5, 3, 0},
          Row{0, 1, 0}, Row{1, 2'147'483'647, 1}, Row{0.999, 2'147'483'647, 0}, Row{0.5, -3, 8},
          Row{0, -3, 0}, Row{-1, -3, 0}, Row{1e-200, -3, highlight_max},
          Row{0.5, std::numeric_limits<int>::min(), highlight_max}}) {
        CAPTURE(row.cosine);
        CAPTURE(row.ns);
        CHECK(highlight(row.cosine, row.ns) == row.want);
    }
}

TEST_CASE("a highlight is as sharp as the exact power, but for its last digits") {
    for_each_seed(1'000, [](Rng& rng) {
        const double cosine = rng.unit();
        const auto ns = static_cast<std::int32_t>(rng.below(300));
        CHECK(highlight(cosine, ns) == doctest::Approx(std::pow(cosine, ns)).epsilon(1e-12));
    });
}

} // namespace
} // namespace fraja::reference
