#include "client/tev/canvas.hpp"
#include "client/tev/packets.hpp"

#include <cstring>
#include <doctest/doctest.h>
#include <fmt/core.h>
#include <string>

using namespace fraja;
using namespace fraja::client;

namespace {

std::string hex(std::span<const std::byte> bytes) {
    std::string text;
    for (const std::byte b : bytes)
        text += fmt::format("{:02x}", static_cast<unsigned>(b));
    return text;
}

/// The packets of one flush, in hex.
std::vector<std::string> flush(tev::Canvas& canvas) {
    std::vector<std::string> packets;
    canvas.begin_flush();
    while (const auto packet = canvas.next_packet())
        packets.push_back(hex(*packet));
    return packets;
}

void fill(Film& film, PixelRect rect, float value) {
    film.place({.rect = rect, .rgb = std::vector<float>(3 * rect.pixel_count(), value)});
}

} // namespace

TEST_CASE("tev is told of an image, and of its end, in the bytes that it expects") {
    CHECK(hex(tev::create_image("t", true, {2, 1})) ==
          "1a00000004017400020000000100000003000000520047004200");
    CHECK(hex(tev::close_image("t")) == "07000000027400");
}

TEST_CASE("tev is told of pixels with their place and order") {
    const std::vector<float> rgb = {1.0F, 0.5F, -2.0F};
    CHECK(hex(tev::update_image("t", {7, 258, 1, 1}, rgb)) ==
          "5e000000" // 94 bytes in all
          "06"       // update
          "00"
          "7400" // no focus; t
          "03000000"
          "520047004200" // R G B
          "07000000"
          "02010000" // at 7, 258
          "01000000"
          "01000000" // 1 x 1
          "0000000000000000"
          "0100000000000000"
          "0200000000000000" // where each begins
          "0300000000000000"
          "0300000000000000"
          "0300000000000000" // how far to its next
          "0000803f"
          "0000003f"
          "000000c0");
}

TEST_CASE("a canvas is created first, and then sends what has changed") {
    Film film({10, 10}, {2, 2, 4, 4});
    tev::Canvas canvas;
    CHECK_FALSE(canvas.is_dirty());
    canvas.begin("t", film);
    const auto first = flush(canvas);
    REQUIRE(first.size() == 3);
    CHECK(first[0] == hex(tev::close_image("t")));
    CHECK(first[1] == hex(tev::create_image("t", true, {4, 4})));
    CHECK(first[2] == hex(tev::update_image("t", {0, 0, 4, 4}, std::vector<float>(48))));
    CHECK_FALSE(canvas.is_dirty());
    CHECK(flush(canvas).empty());

    fill(film, {3, 4, 2, 1}, 0.25F);
    canvas.update({3, 4, 2, 1}, film);
    CHECK(canvas.is_dirty());
    // Places are counted from the picture's corner that there is.
    CHECK(flush(canvas) ==
          std::vector{hex(tev::update_image("t", {1, 2, 2, 1}, std::vector<float>(6, 0.25F)))});
}

TEST_CASE("a canvas sends the newest state, once, of a place that changed often") {
    Film film({8, 1});
    tev::Canvas canvas;
    canvas.begin("t", film);
    (void)flush(canvas);
    for (int i = 0; i < 100; ++i) {
        fill(film, {4, 0, 2, 1}, static_cast<float>(i));
        canvas.update({4, 0, 2, 1}, film);
        canvas.update({4, 0, 1, 1}, film);
    }
    canvas.begin_flush();
    fill(film, {4, 0, 2, 1}, 7); // while the flush is on its way
    canvas.update({4, 0, 2, 1}, film);
    CHECK(hex(canvas.next_packet().value()) ==
          hex(tev::update_image("t", {4, 0, 2, 1}, std::vector<float>(6, 7))));
    CHECK_FALSE(canvas.next_packet());
    CHECK(flush(canvas).size() == 1); // it cannot know that this has gone
}

TEST_CASE("what changed in too many places goes as the rectangle around them") {
    Film film({4 * tev::dirty_max, 2});
    tev::Canvas canvas;
    canvas.begin("t", film);
    (void)flush(canvas);
    for (std::uint32_t i = 0; i <= tev::dirty_max; ++i)
        canvas.update({2 * i, 1, 1, 1}, film);
    const auto packets = flush(canvas);
    REQUIRE(packets.size() == 1);
    CHECK(packets[0] == hex(tev::update_image("t", {0, 1, 2 * tev::dirty_max + 1, 1},
                                              std::vector<float>(3 * (2 * tev::dirty_max + 1)))));
}

TEST_CASE("a large picture goes in packets of about a mebibyte, and again for a new tev") {
    Film film({1024, 256}); // 3 MiB
    tev::Canvas canvas;
    canvas.begin("t", film);
    CHECK(flush(canvas).size() == 2 + 4); // of 85 rows each, and one
    canvas.send_all();
    CHECK(flush(canvas).size() == 2 + 4);
}
