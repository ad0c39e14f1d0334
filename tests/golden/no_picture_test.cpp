// The rows of manifest.csv where Raja fails and has no picture: what is drawn, or said, instead.
#include "common/image/quantise.hpp"
#include "common/image_io/picture_file.hpp"
#include "common/scene/raj_reader.hpp"
#include "tests/support/draw.hpp"

#include <cmath>
#include <cstdlib>
#include <doctest/doctest.h>
#include <filesystem>
#include <string>

namespace fraja {
namespace {

const std::filesystem::path source_dir = FRAJA_SOURCE_DIR;

Result<Drawn> draw_file(const std::string& name, const RenderSettings& settings) {
    auto scene = read_raj_file(source_dir / "scenes" / name);
    if (!scene)
        return scene.error();
    return draw(*scene, Kernel::reference, settings);
}

TEST_CASE("normal_incidence -r 321x241: the middle of the ball fits between its neighbours") {
    const Extent size{321, 241};
    const auto drawn = draw_file("normal_incidence.raj", {.size = size, .depth = 5, .aa = 1});
    REQUIRE(drawn.has_value());
    const auto pixels = drawn->film.pixels();
    for (const float component : pixels) {
        REQUIRE(std::isfinite(component));
        REQUIRE(component > 0);
    }
    const auto at = [&](std::size_t x, std::size_t channel) { // in the middle row, the horizon's
        return pixels[3 * (120 * size.width + x) + channel];
    };
    for (std::size_t channel = 0; channel < 3; ++channel)
        CHECK(at(160, channel) ==
              doctest::Approx((at(159, channel) + at(161, channel)) / 2).epsilon(0.005));
}

TEST_CASE("no_blue -e: drawn, without blue, as without -e to the level") {
    const auto drawn =
        draw_file("no_blue.raj", {.size = {320, 240}, .depth = 5, .aa = 1, .exact = true});
    REQUIRE(drawn.has_value());
    const auto reference = read_levels(source_dir / "tests/golden/reference/no_blue.png");
    REQUIRE(reference.has_value());
    const auto levels = quantise(drawn->film.pixels());
    REQUIRE(levels.size() == reference->rgb.size());
    int greatest = 0;
    std::size_t bright = 0;
    for (std::size_t i = 0; i < levels.size(); ++i) {
        greatest = std::max(greatest, std::abs(int{levels[i]} - int{reference->rgb[i]}));
        bright += levels[i] > 20;
        if (i % 3 == 2)
            REQUIRE(levels[i] == 0);
    }
    CHECK(greatest <= 1);
    CHECK(bright > 50'000);
}

TEST_CASE("missing_texture: the reader refuses it") {
    const auto drawn = draw_file("missing_texture.raj", {});
    REQUIRE(!drawn.has_value());
    CHECK(drawn.error().code == ErrorCode::invalid_scene);
}

TEST_CASE("overlap_without_priority: the first ray that needs the missing priority says so") {
    const auto drawn = draw_file("overlap_without_priority.raj", {.size = {320, 240}, .aa = 1});
    REQUIRE(!drawn.has_value());
    CHECK(drawn.error().code == ErrorCode::unresolved_overlap);
    CHECK(drawn.error().message.find("@a (line 12) and @c (line 14)") != std::string::npos);
}

} // namespace
} // namespace fraja
