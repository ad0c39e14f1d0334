#include "client/film_progress.hpp"

#include "client/json.hpp"

#include <cstdio>
#include <doctest/doctest.h>
#include <memory>
#include <nlohmann/json.hpp>

using namespace fraja;
using namespace fraja::client;
using namespace std::chrono_literals;

namespace {

/// Of ten frames.
struct TenFrames {
    std::unique_ptr<std::FILE, decltype(&std::fclose)> out{std::tmpfile(), &std::fclose};
    Console console{{.program = "fraja-submit"}, out.get()};
    FilmProgress progress{console, ProgressMode::none, "cone", FilmId{}, Instant{}};

    const FilmView& at(Duration elapsed, FilmMoment moment) {
        moment.frame_count = 10;
        progress.update(Instant{} + elapsed, moment);
        return progress.view();
    }
};

} // namespace

TEST_CASE("a film's line tells frames, speed, and time left by all frames at hand together") {
    TenFrames film;
    CHECK(film_line(film.at(0s, {})) == "cone  0 of 10 frames  0%  0:00");
    const FilmView& view = film.at(20s, {.written = 3,
                                         .at_hand = 4,
                                         .share_at_hand = 1,
                                         .share_per_s = 0.2,
                                         .worker_count = 6,
                                         .rays = 40'000'000});
    CHECK(film_line(view) ==
          "cone  3 of 10 frames, 4 at hand  40%  6 workers  2.00 Mray/s  0:20 < 0:30");
    const auto json = nlohmann::json::parse(film_progress_json(view));
    CHECK(json.at("schema") == "fraja.film_progress/1");
    CHECK(json.at("frames_done") == 3);
    CHECK(json.at("frames") == 10);
    CHECK(json.at("frames_at_hand") == 4);
    CHECK(json.at("worker_count") == 6);
    CHECK(json.at("share_done").get<double>() == doctest::Approx(0.4));
    CHECK(json.at("rays_per_s").get<double>() == doctest::Approx(2e6));
    CHECK(json.at("elapsed_s") == 20);
    CHECK(json.at("remaining_s").get<double>() == doctest::Approx(30));
}

TEST_CASE("a film is whole when its last frame is written or given up, not before") {
    TenFrames film;
    CHECK(film.at(9s, {.written = 9, .at_hand = 1, .share_at_hand = 1}).percent() == 99);
    const FilmView& over = film.at(10s, {.written = 9, .given_up = 1, .rays = 10'000});
    CHECK(over.percent() == 100);
    CHECK_FALSE(over.remaining.has_value());
    CHECK(over.rays_per_s == doctest::Approx(1000)); // of all the time
}
