#include "common/render/reference/texture.hpp"

#include <doctest/doctest.h>
#include <initializer_list>
#include <string>

namespace fraja::reference {
namespace {

/// Fields of the chequers around the origin, row by row from the top: '1' and '2'.
std::string fields(ChequeredTexture t) {
    t.kd_one = {1, 1, 1};
    std::string rows;
    for (int y = 2; y >= -2; --y, rows += ' ')
        for (int x = -3; x <= 3; ++x)
            rows += texture_at(t, {t.step * (x + 0.5), t.step * (y + 0.5), 7}).kd.x > 0 ? '1' : '2';
    return rows;
}

TEST_CASE("chequers: the three patterns") {
    using enum ChequeredTexture::Pattern;
    CHECK(fields({.pattern = damier}) == "2121212 1212121 2121212 1212121 2121212 ");
    // Where x's field is before y's, the remainder is never 1.
    CHECK(fields({.pattern = hamier}) == "2222221 2222212 2222122 2221221 2212212 ");
    CHECK(fields({.pattern = mamier}) == "2212212 2122122 1221221 2212212 2122122 ");
}

TEST_CASE("chequers: a step of 0 shows the second colour") {
    const ChequeredTexture t{.kd_one = {1, 1, 1}, .kd_two = {0.5, 0.5, 0.5}, .step = 0};
    CHECK(texture_at(t, {0, 0, 0}).kd == Rgb{0.5, 0.5, 0.5});
}

TEST_CASE("chequers reflect and transmit alike in both colours") {
    const ChequeredTexture t{.kr = {0.1, 0.2, 0.3}, .kt = {0.4, 0.5, 0.6}, .ns = 9};
    const LocalTexture local = texture_at(t, {3.3, 4.4, 5.5});
    CHECK(local.krl == t.kr);
    CHECK(local.krg == t.kr);
    CHECK(local.ktg == t.kt);
    CHECK(local.ns == 9);
}

} // namespace
} // namespace fraja::reference
