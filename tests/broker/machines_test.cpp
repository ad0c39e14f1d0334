// How long machines take for a picture together, and what is said of it meanwhile.
#include "tests/broker/machines.hpp"

#include <cmath>
#include <map>

namespace fraja::broker {
namespace {

using namespace protocol;

double even(PixelRect) {
    return 1;
}
/// A corner is a hundred times as much as the rest.
double uneven(PixelRect r) {
    return r.x < 40 && r.y < 40 ? 100 : 1;
}

TEST_CASE("machines of different speeds end together, on even pictures and uneven ones") {
    for (double (*cost)(PixelRect) : {even, uneven}) {
        Farm farm;
        Machines machines(
            farm, {{"a", 1'000}, {"b", 2'000}, {"c", 4'000}, {"d", 8'000}, {"e", 1'000}}, cost);
        const JobId job = farm.submit("client", automatic(1, 320, 240));
        const double took = seconds(machines.run(job));
        double rays = 0;
        for (std::uint32_t y = 0; y < 240; ++y)
            for (std::uint32_t x = 0; x < 320; ++x)
                rays += cost({x, y, 1, 1});
        CHECK(took < 1.02 * rays / 16'000);
        CHECK(farm.state(job).done_count == farm.state(job).cell_count);
    }
}

/// On the right rays take four times as long as on the left.
double slow_on_the_right(PixelRect r) {
    return r.x >= 320 ? 4 : 1;
}

TEST_CASE("what remains is known, and the share that is done grows, however long rays take where") {
    for (const std::size_t count : {1u, 4u}) {
        CAPTURE(count);
        Farm farm;
        std::vector<Machines::Machine> some;
        for (std::size_t i = 0; i < count; ++i)
            some.push_back({"m" + std::to_string(i), 1'000.0 * static_cast<double>(i + 1)});
        Machines machines(farm, some, even);
        machines.run(farm.submit("client", automatic(1, 160, 120))); // and they are known
        machines.ray_time = slow_on_the_right;
        std::vector<std::pair<double, double>> told; // when, and until when
        const Instant begin = farm.now;
        double share = 0;
        machines.watch = [&](const JobState& s) {
            CHECK(s.share_done > share - 0.02);
            share = s.share_done;
            const double at = seconds(farm.now - begin);
            if (s.share_per_s > 0)
                told.emplace_back(at, at + (1 - s.share_done) / s.share_per_s);
        };
        const double took = seconds(machines.run(farm.submit("client", automatic(2, 640, 480))));
        for (const auto& [at, end] : told)
            if (at > 0.1 * took && at < 0.95 * took)
                CHECK(std::abs(end - took) < 0.2 * (took - at));
    }
}

TEST_CASE("what no probe has seen costs some time, and not much") {
    Farm farm;
    Machines machines(farm, {{"a", 1'000}, {"b", 2'000}, {"c", 4'000}, {"d", 8'000}}, uneven,
                      false);
    CHECK(seconds(machines.run(farm.submit("client", automatic(1, 320, 240)))) <
          1.5 * (320 * 240 + 99 * 40 * 40) / 15'000);
}

TEST_CASE("a machine a thousand times slower than the others delays nobody") {
    Farm farm;
    Machines machines(farm, {{"snail", 5}, {"a", 5'000}, {"b", 5'000}}, even);
    const JobId job = farm.submit("client", automatic(1, 320, 240));
    CHECK(seconds(machines.run(job)) < 1.05 * 320 * 240 / 10'000);
    CHECK(farm.dispatcher.counters().tiles_overbooked > 0);
}

TEST_CASE("a job for few workers goes to the fastest of those who are idle") {
    Farm farm;
    Machines machines(farm, {{"a", 1'000}, {"b", 4'000}, {"c", 2'000}}, uneven);
    machines.run(farm.submit("client", automatic(1, 160, 120))); // and they are known
    SubmitJob s = Farm::picture(2, 20);
    s.wishes.workers_max = 2;
    const JobId job = farm.submit("later", s);
    CHECK(farm.state(job).worker_count == 2);
    CHECK(farm.tiles("a").empty());
    CHECK_FALSE(farm.tiles("b").empty());
    CHECK_FALSE(farm.tiles("c").empty());
    s.job = id_of<JobId>(3);
    s.wishes.workers_max = 1; // of all of whom none is idle but the slow one
    const JobId other = farm.submit("later", s);
    CHECK(farm.state(other).worker_count == 1);
    CHECK(farm.tiles("a").size() == 2);
}

TEST_CASE("every schedule draws the picture, and stealing ends before equal shares do") {
    std::map<Schedule, double> took;
    for (const Schedule schedule :
         {Schedule::demand, Schedule::equal, Schedule::weighted, Schedule::stealing}) {
        Farm farm;
        Machines machines(farm, {{"a", 1'000}, {"b", 2'000}, {"c", 4'000}}, uneven);
        SubmitJob s = automatic(1, 160, 120);
        s.wishes.schedule = schedule;
        took[schedule] = seconds(machines.run(farm.submit("client", s)));
        if (schedule == Schedule::equal)
            CHECK(farm.dispatcher.counters().tiles_overbooked == 0);
    }
    CHECK(took[Schedule::demand] <= took[Schedule::stealing]);
    CHECK(took[Schedule::stealing] < took[Schedule::equal]);
}

} // namespace
} // namespace fraja::broker
