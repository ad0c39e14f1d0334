#include "common/protocol/passes.hpp"

#include "common/protocol/limits.hpp"

#include <doctest/doctest.h>

namespace fraja::protocol {
namespace {

PictureSettings limited(std::uint32_t max_samples) {
    PictureSettings settings;
    settings.time_limit = Duration(1);
    settings.max_samples = max_samples;
    return settings;
}

TEST_CASE("a pass begins where the one before ended, and adds half of what there is at most") {
    std::uint32_t samples = 0;
    for (std::uint32_t i = 0; i < pass_count(limited(samples_max)); ++i) {
        CAPTURE(i);
        const Pass pass = pass_of(i);
        CHECK(pass.first == samples);
        CHECK(pass.count >= 4);
        CHECK(pass.count % 4 == 0);
        if (i >= 2)
            CHECK(2 * pass.count <= samples);
        samples += pass.count;
    }
    CHECK(samples == samples_max);
}

TEST_CASE("there are as many passes as samples are allowed, and at least one") {
    for (const std::uint32_t most : {4u, 5u, 8u, 11u, 12u, 100u, 1024u, 65'536u}) {
        CAPTURE(most);
        const std::uint32_t passes = pass_count(limited(most));
        REQUIRE(passes > 0);
        const Pass last = pass_of(passes - 1), next = pass_of(passes);
        CHECK(last.first + last.count <= most);
        CHECK(next.first + next.count > most);
    }
    CHECK(pass_count(PictureSettings{}) == 1);
}

} // namespace
} // namespace fraja::protocol
