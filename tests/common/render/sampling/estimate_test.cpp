// What a pixel's samples tell of its error.
#include "common/render/sampling/estimate.hpp"

#include <algorithm>
#include <cmath>
#include <doctest/doctest.h>
#include <initializer_list>
#include <vector>

namespace fraja {
namespace {

using Values = std::vector<double>;

/// Three alike of each.
Values grey(const Values& values) {
    Values rgb;
    for (const double value : values)
        rgb.insert(rgb.end(), 3, value);
    return rgb;
}

/// A pixel with these samples, all of one number of them.
PixelSamples judged(const Values& rgb, const Values& cut = {}) {
    PixelSamples pixel(static_cast<std::uint32_t>(rgb.size() / 3));
    pixel.add(rgb, cut);
    pixel.judge();
    return pixel;
}

BaseSamples base(const Values& rgb, std::initializer_list<std::uint64_t> paths) {
    BaseSamples samples;
    samples.add(rgb, std::vector(paths), true);
    return samples;
}

const BaseSamples calm = base(grey({0.5, 0.5, 0.5, 0.5}), {1, 2, 3, 4});
const BaseSamples edge = base(grey({0.1, 0.9, 0.1, 0.9}), {1, 2, 1, 2});
const BaseSamples one_path = base(grey({0.4, 0.5, 0.6, 0.7}), {7, 7, 7, 7});

const Values noise = {0.1, 0.5, 0.2, 0.4, 0.6, 0.1, 0.3, 0.7};
const Values few(noise.begin(), noise.begin() + 4);

TEST_CASE("a pixel's value is the mean of its samples, colour by colour") {
    const PixelSamples pixel =
        judged({0.1, 1, 3, 0.3, 1, 5, 0.2, 1, 3, 0.6, 1, 9}, Values(12, 0.0));
    CHECK(pixel.count() == 4);
    CHECK(pixel.mean()[0] == doctest::Approx(0.3));
    CHECK(pixel.mean()[1] == 1);
    CHECK(pixel.mean()[2] == 5);
}

TEST_CASE("samples may come one by one, and as many again, to the same mean") {
    PixelSamples pixel;
    for (std::size_t i = 0; i < noise.size(); ++i) {
        if (i == base_samples)
            pixel.judge(), pixel.double_expected();
        pixel.add(grey({noise[i]}), {});
        CHECK(pixel.count() == i + 1);
    }
    pixel.judge();
    CHECK(pixel.mean() == judged(grey(noise)).mean());
    CHECK(pixel.mean()[0] == doctest::Approx(2.9 / 8));
}

TEST_CASE("the error is a mean's of four, and what was told of fewer samples counts as well") {
    const double before = judged(grey(few)).error(calm), alone = judged(grey(noise)).error(calm);
    CHECK(before > 0);
    CHECK(judged(grey({0.2, 1.0, 0.4, 0.8})).error(calm) == doctest::Approx(2 * before));
    CHECK(alone < before);
    PixelSamples pixel = judged(grey(few));
    pixel.double_expected();
    pixel.add(grey(Values(noise.begin() + 4, noise.end())), {});
    CHECK(pixel.error(calm) == before); // until it is judged
    pixel.judge();
    const double expected_gain = std::pow(2, -1.4);
    CHECK(pixel.error(calm) * pixel.error(calm) ==
          doctest::Approx((alone * alone + expected_gain * before * before) / 2));
}

TEST_CASE("quarters whose means are equal say that there is no error, whatever is in them") {
    const PixelSamples even = judged(grey({0.2, 0.6, 0.6, 0.2, 0.2, 0.6, 0.6, 0.2}));
    const PixelSamples uneven = judged(grey({0.2, 0.2, 0.6, 0.6, 0.2, 0.2, 0.6, 0.6}));
    CHECK(even.error(calm) < 1e-9);
    CHECK(uneven.error(calm) > 0.05);
    CHECK(even.bound(calm) > 0.01); // but it is not believed
    CHECK(even.bound(calm) < uneven.bound(calm));
}

TEST_CASE("equal samples where there is nothing else have no error") {
    const PixelSamples pixel = judged(grey(Values(8, 0.1)));
    CHECK(pixel.bound(calm) < 1e-8);
    CHECK(pixel.error(calm) < 1e-8);
}

TEST_CASE("contrast around a pixel is what its samples may have missed, ever less of it") {
    const double four = judged(grey(Values(4, 0.5))).bound(edge);
    CHECK(four > 0.8 / 16); // a sixteenth of the pixel is as bright as that
    CHECK(judged(grey(Values(16, 0.5))).bound(edge) == doctest::Approx(four / 8));
    BaseSamples fainter = base(grey({0.3, 0.7}), {1, 2});
    CHECK(judged(grey(Values(4, 0.5))).bound(fainter) == doctest::Approx(four / 2));
    CHECK(judged(grey(Values(4, 0.5))).error(calm) == 0); // nor is it known to be there
}

TEST_CASE("samples that differ bound the error, in proportion") {
    const double bound = judged(grey(few)).bound(calm);
    CHECK(bound >= judged(grey(few)).error(calm));
    CHECK(judged(grey({0.2, 1.0, 0.4, 0.8})).bound(calm) == doctest::Approx(2 * bound));
    CHECK(judged({0.1, 0, 0, 0.5, 0, 0, 0.2, 0, 0, 0.4, 0, 0}).bound(calm) ==
          doctest::Approx(bound / std::sqrt(3)));
}

TEST_CASE("where all samples around met the same, fewer are enough") {
    const PixelSamples pixel = judged(grey({0.4, 0.5, 0.6, 0.7}));
    BaseSamples other_paths = one_path;
    other_paths.one_path = false;
    CHECK(pixel.bound(one_path) < 0.7 * pixel.bound(other_paths));
    CHECK(pixel.bound(one_path) > 0);
    CHECK(judged(grey(Values(4, 0.5))).bound(one_path) < 1e-8);
    CHECK(judged(grey(few)).error(one_path) < judged(grey(few)).error(other_paths));
}

TEST_CASE("what is surely white has no error that is seen, in its colours") {
    const PixelSamples white = judged(grey({5, 6, 5, 6}));
    const BaseSamples around = base(grey({5, 6, 5, 6}), {1, 2, 3, 4});
    CHECK(white.error(calm) == 0);
    CHECK(white.bound(around) == 0);
    CHECK(white.bound(edge) > 0); // something dark may be in it
    CHECK(judged(grey({0.9, 1.3, 0.9, 1.3})).error(calm) > 0);
    CHECK(judged(grey({0.2, 6, 0.2, 6})).bound(around) > 0.1); // on the average only
    const PixelSamples red = judged({5, 0.1, 0, 6, 0.5, 0, 5, 0.2, 0, 6, 0.4, 0});
    CHECK(red.error(calm) == judged({0, 0.1, 0, 0, 0.5, 0, 0, 0.2, 0, 0, 0.4, 0}).error(calm));
    CHECK(red.bound(calm) == judged({0, 0.1, 0, 0, 0.5, 0, 0, 0.2, 0, 0, 0.4, 0}).bound(calm));
}

TEST_CASE("the weight of rays that were cut is an error, and no reason for more samples") {
    const Values same = grey(Values(4, 0.5));
    const Values cut = {0, 0.02, 0.01, 0, 0, 0, 0.06, 0, 0, 0, 0, 0}; // most: 0.02, 0.06
    CHECK(judged(same, cut).error(calm) == doctest::Approx(0.006));
    CHECK(judged(same, cut).bound(calm) == judged(same).bound(calm));
    const double noisy = judged(grey(few)).error(calm);
    CHECK(judged(grey(few), cut).error(calm) == doctest::Approx(std::hypot(noisy, 0.006)));
}

TEST_CASE("first samples have a contrast: of all colours that are not white throughout") {
    CHECK(base({0.2, 0.5, 0.5, 0.7, 0.5, 0.5}, {1, 1}).contrast() ==
          doctest::Approx(0.5 / std::sqrt(3)));
    CHECK(edge.contrast() == doctest::Approx(0.8));
    CHECK(calm.contrast() == 0);
    CHECK(base(grey({1, 7}), {1, 1}).contrast() == 0);
    CHECK(base({1, 0.2, 1, 7, 0.2, 7}, {1, 1}).contrast() == 0);
    CHECK(base(grey({0.9, 7}), {1, 1}).contrast() > 5);
    // Nothing but what was seen: no black or white that was there before.
    CHECK(base(grey({0.6, 0.7}), {1, 1}).contrast() == doctest::Approx(0.1));
}

TEST_CASE("first samples share a path when all do, however they come") {
    CHECK(base(grey({0, 1, 0, 1}), {5, 5, 5, 5}).one_path);
    CHECK_FALSE(base(grey({0, 0, 0, 0}), {5, 5, 5, 6}).one_path);
    BaseSamples pieces = base(grey({0.2}), {5});
    CHECK(pieces.one_path);
    pieces.add(grey({0.3, 0.4}), std::vector<std::uint64_t>{5, 5}, false);
    CHECK(pieces.one_path);
    pieces.add(grey({0.1}), std::vector<std::uint64_t>{6}, false);
    CHECK_FALSE(pieces.one_path);
    CHECK(pieces.contrast() == doctest::Approx(0.3));
}

TEST_CASE("pixels together have all their contrast, and one path if it is the same one") {
    const auto joined = [](BaseSamples a, const BaseSamples& b) {
        a.join(b);
        return a;
    };
    const BaseSamples dark = base(grey({0.1, 0.2}), {5, 5}),
                      bright = base(grey({0.8, 0.6}), {5, 5});
    const BaseSamples elsewhere = base(grey({0.1, 0.2}), {6, 6});
    const BaseSamples mixed = base(grey({0.1, 0.2}), {5, 6});
    for (const auto& [a, b] : {std::pair{dark, bright}, {bright, dark}}) {
        CHECK(joined(a, b).contrast() == doctest::Approx(0.7));
        CHECK(joined(a, b).one_path);
        CHECK(joined(a, b).path == 5);
    }
    CHECK(joined(dark, dark).contrast() == doctest::Approx(0.1));
    for (const auto& [a, b] : {std::pair{dark, elsewhere}, {dark, mixed}, {mixed, dark}})
        CHECK_FALSE(joined(a, b).one_path);
}

} // namespace
} // namespace fraja
