#include "broker/checks.hpp"
#include "tests/broker/farm.hpp"

#include <doctest/doctest.h>

namespace fraja::broker {
namespace {

const Tile one_tile{0, {0, 0, 1, 1}};

Checks::Answer said(std::uint8_t worker, std::uint8_t pixels) {
    return {id_of<WorkerId>(worker), "w" + std::to_string(worker), id_of<ContentHash>(pixels)};
}

/// Of a farm of so many workers, counted from 1.
Checks::HasOthers others_of(std::uint8_t workers) {
    return [workers](const Checks::Check& check) {
        for (std::uint8_t i = 1; i <= workers; ++i)
            if (check.is_new_to(id_of<WorkerId>(i), "w" + std::to_string(i)))
                return true;
        return false;
    };
}

std::vector<WorkerId> answer(Checks& checks, const Checks::Answer& a, std::uint8_t workers) {
    const auto id = checks.next_for(a.worker, a.worker_name, others_of(workers));
    REQUIRE(id);
    checks.assign(*id, {"peer", AttemptNumber{1}});
    return checks.answer(*id, a);
}

TEST_CASE("a tile that two workers draw alike is checked, and no worker checks its own") {
    Checks checks;
    checks.add(one_tile, said(1, 7));
    CHECK(checks.has_pending());
    CHECK_FALSE(checks.next_for(id_of<WorkerId>(1), "w1", others_of(1)));
    CHECK(answer(checks, said(2, 7), 2).empty());
    CHECK(checks.empty());
    CHECK_FALSE(checks.has_pending());
    CHECK(checks.counts() == protocol::CheckCounts{1, 0});
}

TEST_CASE("of three the one is wrong that is alone with what it says") {
    struct Row {
        std::uint8_t first, second, third, wrong;
    };
    for (const Row& row : {Row{6, 7, 7, 1}, Row{7, 6, 7, 2}, Row{7, 6, 6, 1}}) {
        CAPTURE(int{row.wrong});
        Checks checks;
        checks.add(one_tile, said(1, row.first));
        CHECK(answer(checks, said(2, row.second), 3).empty());
        REQUIRE(checks.contested());
        CHECK_FALSE(checks.next_for(id_of<WorkerId>(1), "w1", others_of(3))); // there is a third
        const auto wrong = answer(checks, said(3, row.third), 3);
        REQUIRE(wrong.size() == 1);
        CHECK(wrong[0] == id_of<WorkerId>(row.wrong));
        CHECK(checks.forget(wrong[0]).empty());
        CHECK(checks.empty());
        // What the first had drawn is to be drawn again, and checked then.
        CHECK(checks.counts().agreed == (row.wrong == 1 ? 0 : 1));
    }
}

TEST_CASE("where there is no third, both draw it again, and who contradicts itself is wrong") {
    Checks checks;
    checks.add(one_tile, said(1, 7));
    CHECK(answer(checks, said(2, 6), 2).empty());
    SUBCASE("the first is") {
        const auto wrong = answer(checks, said(1, 6), 2);
        CHECK(wrong == std::vector{id_of<WorkerId>(1)});
        CHECK(checks.forget(wrong[0]).empty());
        CHECK(checks.empty());
    }
    SUBCASE("the second is") {
        const auto wrong = answer(checks, said(2, 9), 2);
        CHECK(wrong == std::vector{id_of<WorkerId>(2)});
        CHECK(checks.forget(wrong[0]).empty());
        CHECK(checks.has_pending()); // the first one's tile is unchecked, as it was
        CHECK_FALSE(checks.contested());
        CHECK(checks.give_up(others_of(1)) == 1);
    }
    SUBCASE("both stay with their words: nobody can tell, and it is not given up") {
        CHECK(answer(checks, said(1, 7), 2).empty());
        CHECK(answer(checks, said(2, 6), 2).empty());
        CHECK_FALSE(checks.next_for(id_of<WorkerId>(1), "w1", others_of(2)));
        CHECK_FALSE(checks.next_for(id_of<WorkerId>(2), "w2", others_of(2)));
        CHECK(checks.give_up(others_of(2)) == 0);
        CHECK(checks.contested());
        CHECK(answer(checks, said(3, 7), 3) == std::vector{id_of<WorkerId>(2)});
    }
}

TEST_CASE("a worker that was started anew is no other one, and does not bear itself out") {
    Checks checks;
    checks.add(one_tile, said(1, 6));
    CHECK_FALSE(checks.next_for(id_of<WorkerId>(9), "w1", others_of(3)));
    CHECK(answer(checks, said(2, 7), 3).empty());
    const Checks::Answer anew{id_of<WorkerId>(9), "w1", id_of<ContentHash>(6)};
    CHECK_FALSE(checks.next_for(anew.worker, anew.worker_name, others_of(3))); // there is a third
    CHECK(answer(checks, anew, 2).empty());                                    // now there is not
    CHECK(answer(checks, said(3, 7), 3) == std::vector{id_of<WorkerId>(1), id_of<WorkerId>(9)});
}

TEST_CASE("a check that a worker cannot draw is for others, and is given up where there is none") {
    Checks checks;
    checks.add(one_tile, said(1, 7));
    const auto id = checks.next_for(id_of<WorkerId>(2), "w2", others_of(2));
    REQUIRE(id);
    checks.assign(*id, {"peer", AttemptNumber{1}});
    CHECK(checks.give_up(others_of(1)) == 0); // somebody is at it
    checks.take_back(*id, id_of<WorkerId>(2));
    CHECK_FALSE(checks.next_for(id_of<WorkerId>(2), "w2", others_of(2)));
    CHECK(checks.give_up(others_of(3)) == 0);
    CHECK(checks.give_up(others_of(2)) == 1);
    CHECK(checks.empty());
    CHECK(checks.counts() == protocol::CheckCounts{0, 1});
}

TEST_CASE("what nobody is there for stays open as long as anything else is") {
    const Tile other_tile{0, {1, 0, 1, 1}};
    Checks checks;
    checks.add(one_tile, said(1, 7));
    CHECK(answer(checks, said(2, 6), 2).empty());
    REQUIRE(checks.contested());
    checks.add(other_tile, said(1, 7));
    CHECK(checks.give_up(others_of(1)) == 0);
    CHECK(checks.tiles() == std::vector{one_tile, other_tile});
    CHECK(answer(checks, said(3, 7), 3) == std::vector{id_of<WorkerId>(2)});
    CHECK(checks.forget(id_of<WorkerId>(2)).empty());
    CHECK(checks.tiles() == std::vector{other_tile}); // the third is there for it now
    CHECK(checks.give_up(others_of(3)) == 0);
    CHECK(checks.give_up(others_of(1)) == 1);
    CHECK(checks.empty());
}

} // namespace
} // namespace fraja::broker
