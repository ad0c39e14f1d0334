// tools/film: from a scene and a travel to a video.
#include "tests/e2e/farm.hpp"

#include <algorithm>
#include <fstream>

using namespace fraja;
using namespace fraja::e2e;

namespace {

const std::string tool = FRAJA_SOURCE_DIR "/tools/film";

RunResult make_film(const Words& arguments, const Words& env = {}) {
    auto result = run({with({tool}, arguments), env}, patience);
    REQUIRE(result.has_value());
    return *std::move(result);
}

std::string where_is(const std::string& name) {
    const auto found = run({{"sh", "-c", "command -v " + name}}, patience);
    return found.has_value() && found->exit == 0 ? found->out.substr(0, found->out.find('\n')) : "";
}

} // namespace

TEST_CASE("a film without what it needs is told so before anything is rendered") {
    const Scratch scratch;
    const std::string mp4 = scratch.file("x.mp4"), cone = scene("cone"),
                      travel = scene("travels/cone");
    // All that the tool itself needs, but no ffmpeg.
    for (const char* name : {"env", "bash", "dirname", "realpath", "sed"})
        fs::create_symlink(where_is(name), scratch.file(name));
    struct Row {
        Words arguments;
        std::string says;
        Words env = {};
    };
    for (const Row& row : {
             Row{{cone, travel}, "-o FILM.mp4 is missing"},
             Row{{cone, travel, "-o", "x.avi"}, "x.avi: a film is .mp4"},
             Row{{cone, travel, "-o", "/no/such/x.mp4"}, "there is no directory /no/such"},
             Row{{cone, travel, "-o", mp4, "--rate", "fast"}, "--rate fast"},
             Row{{cone, travel, "-o", mp4, "--rate"}, "--rate needs a value"},
             Row{{cone, travel, "-o", mp4, "-r", "8x6"}, "those of fraja-submit stand behind --"},
             Row{{cone, travel, "-o", mp4},
                 "sudo apt-get install --no-install-recommends ffmpeg",
                 {"PATH=" + scratch.file("")}},
         }) {
        CAPTURE(row.says);
        const RunResult result = make_film(row.arguments, row.env);
        CAPTURE(result.err);
        CHECK(result.exit == 2);
        CHECK(result.out.empty());
        CHECK(contains(result.err, "tools/film: "));
        CHECK(contains(result.err, row.says));
        CHECK_FALSE(fs::exists(scratch.file("x.frames")));
    }
}

TEST_CASE("a film is rendered and joined, and what is there is not rendered again") {
    const std::string release = FRAJA_SOURCE_DIR "/build/release/bin/fraja-submit";
    if (where_is("ffmpeg").empty() || !fs::exists(release)) {
        MESSAGE("no ffmpeg, or no release build: tools/film is NOT tested to its end");
        return;
    }
    const Scratch scratch;
    const std::string video = scratch.file("cone.mp4");
    const Words words = {scene("cone"), scene("travels/cone"), "-o",  video, "--", "-r", "33x25",
                         "--local",     "--progress",          "none"};
    CHECK(make_film(words).out == video + "\n");
    const std::string first = bytes_of(video);
    CHECK(first.size() > 1000);
    const std::string frame = scratch.file("cone.frames/0003.png");
    const auto others = fs::last_write_time(scratch.file("cone.frames/0001.png"));
    const std::string third = bytes_of(frame);
    fs::remove(frame);
    fs::remove(video);
    CHECK(make_film(words).exit == 0);
    CHECK((bytes_of(frame) == third));
    CHECK(fs::last_write_time(scratch.file("cone.frames/0001.png")) == others);
    CHECK(make_film({"--join", scratch.file("cone.frames/%04d.png"), "-o", scratch.file("c.webm")})
              .exit == 0);
    CHECK(fs::exists(scratch.file("c.webm")));
    const RunResult none = make_film({"--join", scratch.file("no%04d.png"), "-o", video});
    CHECK(none.exit == 2);
    CHECK(contains(none.err, "no%04d.png"));
    CHECK(fs::exists(video)); // the one that was there
    CHECK_FALSE(fs::exists(scratch.file("cone.unfinished.mp4")));
}
