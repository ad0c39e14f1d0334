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
    double time = 0, share = 0;
    std::uint32_t workers = 0;
};

/// What a farm told of a job, from its beginning to its end.
std::vector<Moment> recorded(const std::string& name) {
    std::ifstream file(std::string(FRAJA_SOURCE_DIR) + "/tests/client/progress/" + name + ".txt");
    std::vector<Moment> moments;
    for (std::string line; std::getline(file, line);) {
        if (line.starts_with('#'))
            continue;
        Moment m;
        std::istringstream(line) >> m.time >> m.share >> m.workers;
        moments.push_back(m);
    }
    REQUIRE(moments.size() > 50);
    REQUIRE(moments.back().share == 1);
    return moments;
}

/// By how much of it what is said to remain is wrong, moment by moment from a tenth of the time on;
/// the last twentieth is left out, where seconds are all there is.
std::vector<double> errors(const std::vector<Moment>& moments) {
    const double end = moments.back().time;
    Remaining remaining;
    std::vector<double> all;
    for (const Moment& m : moments) {
        remaining.update(from_seconds(m.time), m.share, m.workers);
        if (m.time < 0.1 * end || m.time > 0.95 * end)
            continue;
        const auto left = remaining.left();
        REQUIRE(left.has_value());
        all.push_back(std::abs(seconds(*left) / (end - m.time) - 1));
    }
    return all;
}

double left_after(const Remaining& remaining) {
    return remaining.left() ? seconds(*remaining.left()) : -1;
}

} // namespace

TEST_CASE("what remains is known within a fifth after the first tenth of recorded jobs") {
    for (const std::string job : {"cone", "spheres", "spheres_scan", "tumbler", "spheres_error"}) {
        CAPTURE(job);
        const auto wrong = errors(recorded(job));
        CHECK(std::ranges::max(wrong) < 0.3);
        const auto outside = std::ranges::count_if(wrong, [](double e) { return e > 0.2; });
        CHECK(static_cast<double>(outside) <= 0.05 * static_cast<double>(wrong.size()));
    }
}

TEST_CASE(
    "nothing is known to remain before there is anything, and the mean is what is known first") {
    Remaining remaining;
    CHECK_FALSE(remaining.left().has_value());
    remaining.update(500ms, 0.1, 1);
    CHECK_FALSE(remaining.left().has_value());
    remaining.update(1500ms, 0, 1);
    CHECK_FALSE(remaining.left().has_value());
    remaining.update(2s, 0.2, 1);
    CHECK(left_after(remaining) == doctest::Approx(8));
}

TEST_CASE("the time in which a farm got under way is not paid twice") {
    Remaining remaining;
    for (int s = 0; s <= 10; ++s)
        remaining.update(std::chrono::seconds(s), 0, 4);
    for (int s = 11; s <= 20; ++s)
        remaining.update(std::chrono::seconds(s), 0.02 * (s - 10), 4);
    CHECK(left_after(remaining) == doctest::Approx(40)); // the mean says 80
}

TEST_CASE("workers that come change what remains, those that come and go do not") {
    Remaining remaining;
    double share = 0;
    int s = 0;
    const auto run = [&](int until, double speed, std::uint32_t workers) {
        for (; s < until; ++s) {
            remaining.update(std::chrono::seconds(s), share, workers);
            share += speed;
        }
    };
    run(100, 0.002, 4);
    run(110, 0.004, 8);
    CHECK(left_after(remaining) == doctest::Approx((1 - share + 0.004) / 0.004));
    run(111, 0.004, 1); // for a moment
    run(120, 0.004, 8);
    CHECK(left_after(remaining) == doctest::Approx((1 - share + 0.004) / 0.004));
}

TEST_CASE("a job that stands still is not promised to end at once") {
    Remaining remaining;
    for (int s = 0; s <= 100; ++s)
        remaining.update(std::chrono::seconds(s), 0.5, 1);
    CHECK(left_after(remaining) == doctest::Approx(100)); // as long as it took
}
