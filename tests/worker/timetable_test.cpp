#include "worker/timetable.hpp"

#include <chrono>
#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::worker;
using namespace std::chrono_literals;

namespace {

using Done = Timetable::Done;
constexpr SessionIndex first{0}, second{1};
constexpr Ticket a{1}, b{2}, c{3}, d{4};
constexpr Instant at(Duration since) {
    return {since};
}

} // namespace

TEST_CASE("a tile takes its rays' time, whatever else happens, by each worker's own speed") {
    Timetable table({1000, 4000}, 1);
    CHECK(table.next_deadline() == Instant::never());
    table.start(at(1s), first, a, 2000);
    table.start(at(1s), second, a, 2000);
    CHECK(table.next_deadline() == at(1500ms));
    CHECK(table.take_done(at(1499ms)).empty());
    CHECK(table.take_done(at(1500ms)) == std::vector{Done{second, a, 500ms}});
    CHECK(table.next_deadline() == at(3s));
    CHECK(table.take_done(at(3s)) == std::vector{Done{first, a, 2s}});
    CHECK(table.next_deadline() == Instant::never());
}

TEST_CASE("what waits begins at the end before it, however late anybody looks") {
    Timetable table({1000}, 1);
    for (const Ticket ticket : {a, b, c})
        table.start(at(0s), first, ticket, 1000);
    CHECK(table.take_done(at(2700ms)) == std::vector{Done{first, a, 1s}, Done{first, b, 1s}});
    CHECK(table.next_deadline() == at(3s));
    CHECK(table.take_done(at(9s)) == std::vector{Done{first, c, 1s}});
}

TEST_CASE("a tile that comes when nothing is left begins then, and not in the past") {
    Timetable table({1000}, 1);
    table.start(at(0s), first, a, 1000);
    table.start(at(1400ms), first, b, 1000);   // nobody has looked since a's end
    CHECK(table.next_deadline() == Instant{}); // a's end is to be told at once
    CHECK(table.take_done(at(1400ms)) == std::vector{Done{first, a, 1s}});
    CHECK(table.next_deadline() == at(2400ms));
}

TEST_CASE("a million small tiles end where their rays' sum says, to a microsecond") {
    Timetable table({3e6}, 1);
    for (std::uint64_t i = 0; i < 1'000'000; ++i)
        table.start(at(0s), first, Ticket{i}, 3000);
    CHECK(table.take_done(at(2000s)).size() == 1'000'000);
    table.start(at(2000s), first, a, 3000);
    CHECK(table.next_deadline() == at(2000s + 1ms));
}

TEST_CASE("threads of a worker take the next tile as they become free") {
    Timetable table({1000}, 2);
    table.start(at(0s), first, a, 3000);
    table.start(at(0s), first, b, 1000);
    table.start(at(0s), first, c, 1000);
    table.start(at(0s), first, d, 1500);
    CHECK(table.take_done(at(10s)) == std::vector{Done{first, b, 1s}, Done{first, c, 1s},
                                                  Done{first, a, 3s}, Done{first, d, 1500ms}});
}

TEST_CASE("a tile that is stopped frees its thread at once") {
    Timetable table({1000}, 1);
    for (const Ticket ticket : {a, b, c})
        table.start(at(0s), first, ticket, 1000);
    table.stop(at(250ms), first, a);
    table.stop(at(300ms), first, c); // it waits
    table.stop(at(300ms), first, d); // there is none
    CHECK(table.take_done(at(10s)) == std::vector{Done{first, b, 1s}});
    CHECK(table.next_deadline() == Instant::never());
    table.start(at(10s), first, a, 1000);
    CHECK(table.next_deadline() == at(11s));
}

TEST_CASE("progress is the share of the rays by the time passed, of tiles that have a thread") {
    Timetable table({1000}, 1);
    table.start(at(0s), first, a, 2000);
    table.start(at(0s), first, b, 2000);
    const auto progress = table.progress(at(500ms), first);
    REQUIRE(progress.size() == 1);
    CHECK(progress[0].ticket == a);
    CHECK(progress[0].rays == 500);
    CHECK(table.progress(at(5s), first).at(0).rays == 2000); // nobody has looked yet
    CHECK(table.take_done(at(2s)).size() == 1);
    CHECK(table.progress(at(2s), first).at(0).ticket == b);
}

TEST_CASE("tiles of no rays and of nearly endless ones break nothing") {
    Timetable table({1e-3}, 1);
    table.start(at(1s), first, a, 0);
    table.start(at(1s), first, b, ~std::uint64_t{0});
    CHECK(table.take_done(at(1s)) == std::vector{Done{first, a, 0s}});
    CHECK(table.next_deadline() > at(1h));
    CHECK(table.progress(at(2s), first).at(0).ticket == b);
}
