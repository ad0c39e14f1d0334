#include "client/film_scenes.hpp"
#include "client/frames.hpp"
#include "common/scene/raj_reader.hpp"

#include <doctest/doctest.h>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace fraja::client {
namespace {

TEST_CASE("so many frames are submitted at a time as their pictures have room, and not too many") {
    const auto at_a_time = [](std::uint32_t side) {
        return frames_at_a_time({.size = {side, side}, .crop = {0, 0, side, side}});
    };
    CHECK(at_a_time(1) == frames_at_a_time_max);
    CHECK(at_a_time(2'048) == frames_bytes_max / (2'048 * 2'048 * 12));
    CHECK(at_a_time(16'384) == 1); // 3 GiB: alone it is drawn all the same
}

TEST_CASE("frames are written A, A-B or A-BxS and nothing else") {
    struct Row {
        std::string_view text;
        std::optional<FrameRange> want;
    };
    for (const Row& row :
         {Row{"1-12", FrameRange{1, 12, 1}}, Row{"3-9x2", FrameRange{3, 9, 2}},
          Row{"7", FrameRange{7, 7, 1}}, Row{"7-7x100", FrameRange{7, 7, 100}},
          Row{"1-4294967295", FrameRange{1, 4294967295, 1}}, Row{"", std::nullopt},
          Row{"0-3", std::nullopt}, Row{"4-3", std::nullopt}, Row{"1-", std::nullopt},
          Row{"-3", std::nullopt}, Row{"1-3x0", std::nullopt}, Row{"1-3x", std::nullopt},
          Row{"1x2", std::nullopt}, Row{"1-3-5", std::nullopt}, Row{"1 - 3", std::nullopt},
          Row{"1-3x2x2", std::nullopt}, Row{"1-4294967296", std::nullopt},
          Row{"a-b", std::nullopt}}) {
        CAPTURE(row.text);
        CHECK(parse_frames(row.text) == row.want);
    }
}

TEST_CASE("a film's files are numbered where the pattern says so, once") {
    struct Row {
        std::string_view pattern, seventh, large; ///< frame 7, and frame 123456; empty: it is bad
    };
    for (const Row& row :
         {Row{"cone%04d.png", "cone0007.png", "cone123456.png"}, Row{"%d", "7", "123456"},
          Row{"a/%03d/x.exr", "a/007/x.exr", "a/123456/x.exr"},
          Row{"%09d.png", "000000007.png", "000123456.png"}, Row{"cone.png", "", ""},
          Row{"%", "", ""}, Row{"%0d.png", "", ""}, Row{"%00d.png", "", ""},
          Row{"%010d.png", "", ""}, Row{"%4d.png", "", ""}, Row{"%s.png", "", ""},
          Row{"%04x.png", "", ""}, Row{"%d%d.png", "", ""}, Row{"%%%d.png", "", ""},
          Row{"%d%.png", "", ""}, Row{"%04", "", ""}}) {
        CAPTURE(row.pattern);
        const bool is_good = check_frame_pattern(row.pattern).has_value();
        CHECK(is_good == !row.seventh.empty());
        if (!is_good)
            continue;
        CHECK(frame_file(row.pattern, 7) == row.seventh);
        CHECK(frame_file(row.pattern, 123456) == row.large);
    }
}

TEST_CASE("files of frames are told in runs, and what is missing between them is not told") {
    using Files = std::vector<std::string>;
    struct Row {
        Files files;
        const char* text;
    };
    for (const Row& row : {
             Row{{}, ""},
             Row{{"", ""}, ""},
             Row{{"1"}, "1"},
             Row{{"1", "2"}, "1, 2"},
             Row{{"", "2", "3", "4", ""}, "2 ... 4"},
             Row{{"1", "", "", "", "5"}, "1, 5"},
             Row{{"1", "2", "3", "", "5", "6", "", "8"}, "1 ... 3, 5, 6, 8"},
             Row{{"1", "", "1", "", "1", "", "1", "", "1",  "",
                  "1", "", "1", "", "8", "", "9", "", "10", "11"},
                 "1, 1, 1, 1, 1, 1, 1, 8 and 3 more"},
         }) {
        CAPTURE(row.text);
        CHECK(runs_of(row.files) == row.text);
    }
}

TEST_CASE("a frame's scene is the scene with that frame's camera, and nothing else is changed") {
    const std::string folder = std::string(FRAJA_SOURCE_DIR) + "/scenes/";
    std::vector<std::string> warnings;
    const auto film = FilmScenes::read(folder + "cone.raj", folder + "travels/cone.raj", warnings);
    REQUIRE(film.has_value());
    CHECK(warnings.empty());
    REQUIRE(film->frame_count() == 12);
    const auto scene = read_raj_file(folder + "cone.raj");
    const auto cameras = read_raj_cameras_file(folder + "travels/cone.raj");
    REQUIRE(scene.has_value());
    REQUIRE(cameras.has_value());
    std::set<std::string> hashes;
    for (std::uint32_t n = 1; n <= 12; ++n) {
        const auto text = film->frame(n);
        REQUIRE(text.has_value());
        const auto read = read_raj(as_text(text->text), "frame");
        REQUIRE(read.has_value());
        Scene want = *scene;
        want.camera = cameras->at(n - 1);
        CHECK((*read == want));
        hashes.insert(fraja::to_string(text->hash));
    }
    CHECK(hashes.size() == 12);
}

} // namespace
} // namespace fraja::client
