#include "client/remaining.hpp"

#include <algorithm>
#include <cmath>
#include <doctest/doctest.h>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

using namespace fraja;
using namespace fraja::client;
using namespace std::chrono_literals;

namespace {

struct Moment {
    double time = 0, share = 0, share_per_s = 0;
};

/// What a farm told of a job, from its beginning to its end.
std::vector<Moment> recorded(const std::string& name) {
    std::ifstream file(std::string(FRAJA_SOURCE_DIR) + "/tests/client/progress/" + name + ".txt");
    std::vector<Moment> moments;
    for (std::string line; std::getline(file, line);) {
        if (line.starts_with('#'))
            continue;
        Moment m;
        std::istringstream(line) >> m.time >> m.share >> m.share_per_s;
        moments.push_back(m);
    }
    REQUIRE(moments.size() > 50);
    REQUIRE(moments.back().share == 1);
    return moments;
}

/// By how much of it what is said to remain is wrong, moment by moment from a tenth of the time on.
/// It is told in seconds: one that is right to a second is right.
std::vector<double> errors(const std::vector<Moment>& moments) {
    const double end = moments.back().time;
    Remaining remaining;
    std::vector<double> all;
    for (const Moment& m : moments) {
        remaining.update(from_seconds(m.time), m.share, m.share_per_s);
        if (m.time < 0.1 * end || m.share == 1)
            continue;
        const auto left = remaining.left();
        REQUIRE(left.has_value());
        const double wrong = std::abs(seconds(*left) - (end - m.time));
        all.push_back(wrong < 1 ? 0 : wrong / (end - m.time));
    }
    return all;
}

double left_after(const Remaining& remaining) {
    return remaining.left() ? seconds(*remaining.left()) : -1;
}

} // namespace

TEST_CASE("what remains is known within a fifth after the first tenth of recorded jobs") {
    for (const std::string job : {"cone", "csg", "glass", "mirrors", "spheres"}) {
        CAPTURE(job);
        const auto wrong = errors(recorded(job));
        CHECK(std::ranges::max(wrong) < 0.25);
        const auto outside = std::ranges::count_if(wrong, [](double e) { return e > 0.2; });
        CHECK(static_cast<double>(outside) <= 0.03 * static_cast<double>(wrong.size()));
    }
}

TEST_CASE("nothing is known to remain before there is a pace") {
    Remaining remaining;
    CHECK_FALSE(remaining.left().has_value());
    remaining.update(500ms, 0.1, 0);
    CHECK_FALSE(remaining.left().has_value());
    remaining.update(2s, 0.2, 0.1);
    CHECK(left_after(remaining) == doctest::Approx(8));
}

TEST_CASE("of a job that has just begun to be drawn nobody says when it ends") {
    Remaining remaining;
    remaining.update(100ms, 0.24, 1e-4);
    CHECK_FALSE(remaining.left().has_value());
    remaining.update(900ms, 0.5, 0.4);
    CHECK_FALSE(remaining.left().has_value());
    remaining.update(1s, 0.52, 0.4);
    CHECK(remaining.left().has_value());
    Remaining waited;
    for (Duration t = 0s; t <= 5s; t += 1s)
        waited.update(t, 0, 0);
    waited.update(5900ms, 0.1, 1e-4);
    CHECK_FALSE(waited.left().has_value());
    waited.update(6s, 0.2, 0.2);
    CHECK(waited.left().has_value());
}

TEST_CASE("how long it took to get under way says nothing of what remains") {
    Remaining remaining;
    remaining.update(1000s, 0, 0);
    remaining.update(1001s, 0.01, 0.01);
    CHECK(left_after(remaining) == doctest::Approx(99));
}

TEST_CASE("workers that come change what remains, those that come and go do not") {
    Remaining remaining;
    double share = 0;
    int s = 0;
    const auto run = [&](int until, double pace) {
        for (; s < until; ++s) {
            remaining.update(std::chrono::seconds(s), share, pace);
            share += pace;
        }
    };
    run(100, 0.002);
    CHECK(left_after(remaining) == doctest::Approx((1 - share + 0.002) / 0.002));
    run(150, 0.004);
    CHECK(left_after(remaining) == doctest::Approx((1 - share + 0.004) / 0.004).epsilon(0.03));
    run(151, 0.002); // for a moment
    CHECK(left_after(remaining) == doctest::Approx((1 - share + 0.002) / 0.004).epsilon(0.125));
}

TEST_CASE("a film whose machines go from frame to frame is not thought to stand still") {
    const auto left_after_gap = [](Remaining::Of what) {
        Remaining remaining(what);
        for (int i = 0; i <= 40; ++i) // 100 s of work; for 200 ms a tenth of the pace is known
            remaining.update(i * 100ms, 0.001 * i, i > 38 ? 0.001 : 0.01);
        return seconds(remaining.left().value());
    };
    CHECK(left_after_gap(Remaining::Of::film) < 1.6 * 96);
    CHECK(left_after_gap(Remaining::Of::job) > 2 * 96);
}

TEST_CASE("a pace that was thought to be far too high at first is forgotten within a second") {
    Remaining remaining;
    remaining.update(100ms, 0.01, 3);
    for (Duration t = 200ms; t <= 1s; t += 100ms)
        remaining.update(t, 0.02, 0.1);
    CHECK(left_after(remaining) == doctest::Approx(9.8).epsilon(0.15));
}

TEST_CASE("of a job that stands still nobody says when it ends") {
    Remaining remaining;
    remaining.update(1s, 0.5, 0.1);
    remaining.update(3s, 0.5, 0);
    CHECK(left_after(remaining) == doctest::Approx(5)); // between two tiles
    remaining.update(5s, 0.5, 0);
    CHECK_FALSE(remaining.left().has_value());
    remaining.update(60s, 0.5, 0.05);
    CHECK(left_after(remaining) == doctest::Approx(10));
}
