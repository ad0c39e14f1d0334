#include "common/protocol/bitmap.hpp"
#include "common/protocol/content_hash.hpp"
#include "common/protocol/limits.hpp"
#include "common/protocol/messages.hpp"
#include "common/protocol/settings.hpp"
#include "common/protocol/topics.hpp"

#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::protocol;

TEST_CASE("the content hash is BLAKE2b-256") {
    CHECK(to_string(content_hash({})) ==
          "0e5751c026e543b2e8ab2eb06099daa1d1e5df47778f7787faab45cdf12fe3a8");
    CHECK(to_string(content_hash(to_bytes("abc"))) ==
          "bddd813c634239723171ef3fee98579b94964e3bb1cb3e427262c8c068d52319");
}

TEST_CASE("a bitmap keeps its bits and has none beyond its end") {
    Bitmap bits(10);
    bits.set(0);
    bits.set(9);
    CHECK(bits.bytes() == Bytes{std::byte{1}, std::byte{2}});
    CHECK(bits.test(9));
    CHECK_FALSE(bits.test(8));
    CHECK_FALSE(bits.test(1000));
    CHECK_FALSE(Bitmap(Bytes{}).test(0));
}

TEST_CASE("topics are short and lead back to their ids") {
    const auto job = random_id<JobId>();
    CHECK(topic_id<JobId>('J', job_topic(job)) == job);
    CHECK_FALSE(topic_id<JobId>('N', job_topic(job)).has_value());
    CHECK_FALSE(topic_id<JobId>('J', "J123").has_value());
    CHECK_FALSE(topic_id<JobId>('J', "").has_value());
    CHECK(job_topic(job).size() < 246);
}

TEST_CASE("sums of rays take in every count and stay at the largest number") {
    Rays sum{1, 2, 3, 4, 5, 6, 7, 8, 9};
    sum += {10, 20, 30, 40, 50, 60, 70, 80, 90};
    CHECK(sum == Rays{11, 22, 33, 44, 55, 66, 77, 88, 99});
    CHECK(sum.traced() == 66);
    CHECK(sum.total() == 110);
    sum += {.refracted = UINT64_MAX, .truncated_pixels = UINT64_MAX};
    CHECK(sum == Rays{11, 22, UINT64_MAX, 44, 55, 66, 77, 88, UINT64_MAX});
    CHECK(sum.total() == UINT64_MAX);
}

TEST_CASE("settings are held against the limits") {
    struct Row {
        const char* what;
        PictureSettings settings;
        bool valid;
    };
    const auto sized = [](std::uint32_t w, std::uint32_t h) {
        PictureSettings s;
        s.size = {w, h};
        s.crop = {0, 0, w, h};
        return s;
    };
    const auto with = [](auto change) {
        PictureSettings s;
        change(s);
        return s;
    };
    for (const Row& row : {
             Row{"defaults", PictureSettings{}, true},
             Row{"one pixel", sized(1, 1), true},
             Row{"no pixel", sized(0, 10), false},
             Row{"side at the limit", sized(picture_side_max, 1), true},
             Row{"side beyond it", sized(picture_side_max + 1, 1), false},
             Row{"pixels at the limit",
                 sized(picture_side_max, picture_pixels_max / picture_side_max), true},
             Row{"pixels beyond it",
                 sized(picture_side_max, picture_pixels_max / picture_side_max + 1), false},
             Row{"empty crop", with([](auto& s) {
                     s.crop = {0, 0, 0, 5};
                 }),
                 false},
             Row{"crop outside", with([](auto& s) {
                     s.crop = {1, 0, 256, 192};
                 }),
                 false},
             Row{"crop that overflows", with([](auto& s) {
                     s.crop = {4'294'967'295u, 0, 2, 2};
                 }),
                 false},
             Row{"depth at the limit", with([](auto& s) { s.depth = depth_max; }), true},
             Row{"depth beyond it", with([](auto& s) { s.depth = depth_max + 1; }), false},
             Row{"aa at the limit", with([](auto& s) { s.aa = aa_max; }), true},
             Row{"aa beyond it", with([](auto& s) { s.aa = aa_max + 1; }), false},
             Row{"spp at the limit", with([](auto& s) { s.spp = samples_max; }), true},
             Row{"spp beyond it", with([](auto& s) { s.spp = samples_max + 1; }), false},
             Row{"error at the limit", with([](auto& s) { s.error = error_max; }), true},
             Row{"error beyond it", with([](auto& s) { s.error = error_max * 1.001; }), false},
             Row{"error below 0", with([](auto& s) { s.error = -1; }), false},
             Row{"samples at their limits",
                 with([](auto& s) { s.error = 1, s.max_samples = samples_min; }), true},
             Row{"a ceiling below the least",
                 with([](auto& s) { s.max_samples = samples_min - 1; }), false},
             Row{"a ceiling above the most", with([](auto& s) { s.max_samples = samples_max + 1; }),
                 false},
             Row{"two numbers of samples", with([](auto& s) { s.aa = 2, s.spp = 4; }), false},
             Row{"samples and an error", with([](auto& s) { s.error = 1, s.spp = 4; }), false},
             Row{"the longest time", with([](auto& s) { s.time_limit = time_limit_max; }), true},
             Row{"more than that", with([](auto& s) { s.time_limit = time_limit_max * 2; }), false},
             Row{"a time before now", with([](auto& s) { s.time_limit = -Duration(1); }), false},
             Row{"a time and samples", with([](auto& s) { s.time_limit = Duration(1), s.spp = 4; }),
                 false},
             Row{"a filter of samples",
                 with([](auto& s) { s.spp = 4, s.filter = PixelFilter::tent; }), true},
             Row{"a filter of a grid",
                 with([](auto& s) { s.aa = 4, s.filter = PixelFilter::tent; }), false},
         }) {
        CAPTURE(row.what);
        CHECK(validate(row.settings).has_value() == row.valid);
    }
}
