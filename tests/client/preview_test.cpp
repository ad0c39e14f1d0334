#include "client/preview/blocks.hpp"
#include "client/preview/kitty.hpp"
#include "client/preview/preview.hpp"
#include "client/preview/shrink.hpp"
#include "client/preview/sixel.hpp"
#include "common/base/rng.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <regex>
#include <sodium.h>
#include <string>
#include <vector>

using namespace fraja;
using namespace fraja::client;

namespace {

LevelsPicture noise(Extent extent) {
    Rng rng(7);
    LevelsPicture levels{extent, {}};
    for (std::size_t i = 0; i < 3 * extent.pixel_count(); ++i)
        levels.rgb.push_back(static_cast<std::uint8_t>(rng.below(256)));
    return levels;
}

/// A film of these levels, in the middle of a larger picture.
Film film_of(const LevelsPicture& levels) {
    const auto [width, height] = levels.extent;
    Film film({width + 2, height + 2}, {1, 1, width, height});
    Tile tile{.rect = film.region(), .rgb = {}};
    for (const std::uint8_t level : levels.rgb)
        tile.rgb.push_back(static_cast<float>(level) / 255);
    film.place(tile);
    return film;
}

/// The words between `begin` and `end`, one after the other; nothing may stand between them.
std::vector<std::string> framed(std::string_view text, std::string_view begin,
                                std::string_view end) {
    std::vector<std::string> all;
    while (!text.empty()) {
        REQUIRE(text.starts_with(begin));
        text.remove_prefix(begin.size());
        const auto at = text.find(end);
        REQUIRE(at != std::string_view::npos);
        all.emplace_back(text.substr(0, at));
        text.remove_prefix(at + end.size());
    }
    return all;
}

std::vector<std::uint8_t> decoded(const std::string& base64) {
    std::vector<std::uint8_t> bytes(base64.size());
    std::size_t size = 0;
    REQUIRE(sodium_base642bin(bytes.data(), bytes.size(), base64.data(), base64.size(), nullptr,
                              &size, nullptr, sodium_base64_VARIANT_ORIGINAL) == 0);
    bytes.resize(size);
    return bytes;
}

} // namespace

TEST_CASE("a picture is as large as the window allows, in its own shape") {
    const Window window{.columns = 100, .rows = 40, .cell_width = 10, .cell_height = 20};
    CHECK(fit_blocks({640, 480}, window) == Fit{100, 38, {100, 75}}); // 1000 pixels wide, 750 high
    CHECK(fit_blocks({100, 1000}, window) == Fit{8, 40, {8, 80}});
    CHECK(fit_blocks({1, 1'000'000}, window) == Fit{1, 40, {1, 80}});
    CHECK(fit_kitty({640, 480}, window) == Fit{100, 38, {640, 480}}); // the terminal enlarges
    CHECK(fit_kitty({6400, 4800}, window) == Fit{100, 38, {1000, 750}});
    CHECK(fit_sixel({640, 480}, window) == Fit{100, 38, {1000, 750}});
    CHECK(fit_sixel({1'000'000, 1}, window) == Fit{100, 1, {1000, 6}});
    const Window huge{.columns = 65535, .rows = 65535};
    CHECK(fit_blocks({1, 1}, huge).rows == preview_rows_max);
    CHECK(fit_blocks({1000, 1}, huge).columns == preview_columns_max);
}

TEST_CASE("a picture is made smaller by the mean of what each pixel covers") {
    const LevelsPicture four{{4, 2}, {0,  0, 0, 10, 0, 0, 100, 0, 0, 200, 0, 0, //
                                      20, 0, 0, 30, 0, 0, 100, 8, 0, 200, 0, 4}};
    CHECK(shrink(film_of(four), {2, 1}).rgb == std::vector<std::uint8_t>{15, 0, 0, 150, 2, 1});
    CHECK(shrink(film_of(four), {4, 2}) == four);
    // Three pixels on two: half of the middle one each.
    const LevelsPicture three{{3, 1}, {30, 0, 0, 60, 0, 0, 90, 0, 0}};
    CHECK(shrink(film_of(three), {2, 1}).rgb == std::vector<std::uint8_t>{40, 0, 0, 80, 0, 0});
    CHECK(shrink(film_of(three), {6, 1}).rgb ==
          std::vector<std::uint8_t>{30, 0, 0, 30, 0, 0, 60, 0, 0, 60, 0, 0, 90, 0, 0, 90, 0, 0});
}

TEST_CASE("a mean is that of the whole, whatever the sizes") {
    const LevelsPicture levels = noise({37, 23});
    double want = 0;
    for (const std::uint8_t level : levels.rgb)
        want += level / static_cast<double>(levels.rgb.size());
    for (const Extent size : {Extent{1, 1}, Extent{5, 3}, Extent{36, 22}, Extent{80, 50}}) {
        double mean = 0;
        const auto small = shrink(film_of(levels), size);
        for (const std::uint8_t level : small.rgb)
            mean += level / static_cast<double>(small.rgb.size());
        CHECK(mean == doctest::Approx(want).epsilon(0.01));
    }
}

TEST_CASE("half blocks are two pixels each, and colours are named when they change") {
    const LevelsPicture levels{{2, 3},
                               {255, 0, 0, 255, 0, 0, //
                                0, 0, 9, 0, 0, 8,     //
                                1, 2, 3, 1, 2, 3}};
    CHECK(blocks_image(levels, ColorDepth::direct) ==
          "\x1b[38;2;255;0;0m\x1b[48;2;0;0;9m\u2580\x1b[48;2;0;0;8m\u2580\x1b[0m\r\n"
          "\x1b[38;2;1;2;3m\u2580\u2580\x1b[0m");
    CHECK(blocks_image({{1, 1}, {255, 0, 0}}, ColorDepth::indexed) ==
          "\x1b[38;5;196m\u2580\x1b[0m");
}

TEST_CASE("of the 256 colours the nearest is taken, from the cube or the greys") {
    CHECK(indexed_color(0, 0, 0) == 16);
    CHECK(indexed_color(255, 255, 255) == 231);
    CHECK(indexed_color(128, 128, 128) == 244);
    CHECK(indexed_color(8, 8, 8) == 232);
    CHECK(indexed_color(95, 135, 175) == 16 + 36 + 12 + 3);
}

TEST_CASE("kitty gets every pixel, in chunks, the first of which says what it is") {
    const LevelsPicture levels = noise({61, 47}); // 8601 bytes: three chunks
    const auto chunks = framed(kitty_image(levels, 9, 20, 8), "\x1b_G", "\x1b\\");
    REQUIRE(chunks.size() == 3);
    std::string base64;
    for (std::size_t i = 0; i < chunks.size(); ++i) {
        const auto split = chunks[i].find(';');
        const std::string keys = chunks[i].substr(0, split), data = chunks[i].substr(split + 1);
        const std::string more = i + 1 < chunks.size() ? "m=1" : "m=0";
        CHECK(keys == (i == 0 ? "a=T,f=24,s=61,v=47,i=9,p=1,c=20,r=8,C=1,q=2," + more : more));
        CHECK(data.size() <= 4096);
        CHECK((i + 1 == chunks.size() || data.size() % 4 == 0));
        base64 += data;
    }
    CHECK(decoded(base64) == levels.rgb);
    CHECK(kitty_removal(9) == "\x1b_Ga=d,d=I,i=9,q=2\x1b\\");
}

TEST_CASE("sixels are one device control string of as many pixels, or a reason") {
    const auto image = sixel_image({{12, 6}, std::vector<std::uint8_t>(3 * 12 * 6, 200)});
    if (!check_sixel()) {
        REQUIRE_FALSE(image.has_value());
        CHECK(image.error().message.find("libchafa") != std::string::npos);
        return;
    }
    REQUIRE(image.has_value());
    const auto strings = framed(*image, "\x1bP", "\x1b\\");
    REQUIRE(strings.size() == 1);
    std::smatch size;
    REQUIRE(std::regex_search(strings[0], size, std::regex(R"(q"1;1;(\d+);(\d+))")));
    CHECK(size[1] == "12");
    CHECK(size[2] == "6");
    // One colour, near to 200 of 255 in hundredths, all over.
    std::smatch color;
    REQUIRE(std::regex_search(strings[0], color, std::regex(R"(#(\d+);2;(\d+);(\d+);(\d+))")));
    CHECK(std::abs(std::stoi(color[2]) - 78) <= 1);
    CHECK(strings[0].find("!12~") != std::string::npos);
}

TEST_CASE("the best way is chosen by what the terminal says of itself") {
    const auto with = [](bool sixel) { return [sixel] { return sixel; }; };
    CHECK(best_mode({.term = "xterm-kitty"}, with(true)) == PreviewMode::kitty);
    CHECK(best_mode({.term = "xterm", .kitty_window = true}, with(false)) == PreviewMode::kitty);
    CHECK(best_mode({.term = "xterm", .term_program = "WezTerm"}, with(true)) ==
          PreviewMode::kitty);
    CHECK(best_mode({.term = "tmux-256color", .kitty_window = true, .multiplexed = true},
                    with(false)) == PreviewMode::blocks);
    CHECK(best_mode({.term = "xterm-256color"}, with(true)) == PreviewMode::sixel);
    CHECK(best_mode({.term = "xterm-256color"}, with(false)) == PreviewMode::blocks);
    CHECK(best_mode({.term = "dumb"}, with(true)) == PreviewMode::none);
    CHECK(best_mode({.kitty_window = true}, with(true)) == PreviewMode::none);
    CHECK(color_depth({.colorterm = "truecolor"}) == ColorDepth::direct);
    CHECK(color_depth({.term = "xterm-256color"}) == ColorDepth::indexed);
}

TEST_CASE("a preview takes the rows that it says") {
    const Film film = film_of(noise({64, 48}));
    const Window window{.columns = 40, .rows = 20, .cell_width = 10, .cell_height = 20};
    const auto blocks = make_preview(film, window, PreviewMode::blocks, ColorDepth::direct);
    REQUIRE(blocks.has_value());
    CHECK(blocks->rows == 15);
    CHECK(std::ranges::count(blocks->bytes, '\n') == 14);
    CHECK(blocks->removal.empty());
    const auto kitty = make_preview(film, window, PreviewMode::kitty, ColorDepth::direct);
    REQUIRE(kitty.has_value());
    CHECK(kitty->rows == 15);
    CHECK(kitty->removal.starts_with("\x1b_Ga=d"));
}
