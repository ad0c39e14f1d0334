// Who stands for whom, and who leads.
#include "broker/membership.hpp"

#include "tests/broker/farm.hpp"

#include <chrono>
#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::broker;
using namespace std::chrono_literals;
using Change = Membership::Change;

namespace {

constexpr Membership::Terms terms{.patience = 1300ms,
                                  .patience_max = 2600ms,
                                  .settling = 500ms,
                                  .told_patience = 3250ms,
                                  .told_margin = 650ms,
                                  .workers_patience = 5s,
                                  .workers_settling = 2s,
                                  .counter_min = 100,
                                  .rumours_apart = 10s};

/// Named by when it started.
BrokerId broker_of(std::uint8_t number) {
    return id_of<BrokerId>(number);
}
Membership::Rank rank_of(std::uint8_t number) {
    return {std::chrono::seconds(number), broker_of(number)};
}
protocol::BrokerHello hello_of(std::uint8_t number) {
    return {.broker = broker_of(number),
            .started_at = std::chrono::seconds(number),
            .endpoint = "tcp://b" + std::to_string(number) + ":50057",
            .program_version = "1",
            .keeps = true};
}
protocol::BrokerBeat beat_of(std::uint8_t number, bool is_synced, protocol::Term term = {}) {
    return {.broker = broker_of(number), .term = term, .is_synced = is_synced, .brokers = {}};
}

/// One of several, that has met the others and has all that they have.
struct One {
    explicit One(std::uint8_t number) : membership(rank_of(number), terms, false, now) {
        membership.set_synced(now);
    }
    void meet(std::uint8_t number, bool is_synced = true, protocol::Term term = {}) {
        (void)membership.meet(now, hello_of(number));
        membership.hear(now, beat_of(number, is_synced, term));
    }
    Change after(Duration time) {
        now = now + time;
        return membership.update(now);
    }

    Instant now{};
    Membership membership;
};

} // namespace

TEST_CASE(
    "two that have heard of nobody, though they were told of others, begin terms of their own") {
    std::vector<protocol::Term> begun;
    for (const std::uint8_t number : {std::uint8_t{1}, std::uint8_t{2}}) {
        Membership one(rank_of(number), terms, false, Instant{});
        one.set_synced(Instant{});
        REQUIRE(one.update(Instant{} + 1h) == Change::begins_to_lead);
        begun.push_back(one.term());
    }
    CHECK(begun[0].counter != begun[1].counter);
}

TEST_CASE("a broker that stands alone leads at once") {
    Membership membership(rank_of(1), terms, true, {});
    CHECK(membership.update({}) == Change::begins_to_lead);
    CHECK(membership.term() == protocol::Term{100, broker_of(1)});
    CHECK(membership.update({}) == Change::none);
}

TEST_CASE("one that has others looks around before it leads") {
    One one(1);
    CHECK(one.after(2599ms) == Change::none);
    CHECK(one.after(1ms) == Change::begins_to_lead);
    CHECK(one.membership.next_deadline(one.now) == Instant::never());
}

TEST_CASE("who started first leads, of those who are here and have all that there is") {
    struct Row {
        const char* what;
        bool other_is_synced;
        std::uint8_t own, other;
        bool leads;
    };
    for (const Row& row :
         {Row{"it started first", true, 1, 2, true}, Row{"the other did", true, 2, 1, false},
          Row{"the other did, and lacks something", false, 2, 1, true}}) {
        CAPTURE(row.what);
        One one(row.own);
        one.after(2500ms);
        one.meet(row.other, row.other_is_synced);
        (void)one.after(100ms);
        CHECK(one.membership.leads() == row.leads);
    }
}

TEST_CASE("one that lacks something does not lead, however alone it is") {
    Membership membership(rank_of(1), terms, false, {});
    const Instant now = Instant{} + 1h;
    CHECK(membership.update(now) == Change::none);
    membership.set_synced(now);
    CHECK(membership.update(now + 499ms) == Change::none); // others may have come to that, too
    CHECK(membership.next_deadline(now) == now + 500ms);
    CHECK(membership.update(now + 500ms) == Change::begins_to_lead);
}

TEST_CASE("the next one takes over when the leader is gone, with a greater term") {
    One one(2);
    one.after(2500ms);
    one.meet(1, true, {500, broker_of(1)});
    CHECK(one.membership.term() == protocol::Term{500, broker_of(1)});
    CHECK(one.after(1300ms) == Change::none);
    CHECK(one.membership.next_deadline(one.now - 1ms) <= one.now + 1ns);
    CHECK(one.after(1ns) == Change::begins_to_lead);
    CHECK(one.membership.term().counter > 500);
    CHECK(one.membership.term().leader == broker_of(2));
    one.meet(1, true, {500, broker_of(1)}); // it comes back
    CHECK(one.after(0s) == Change::leads_no_more);
}

TEST_CASE("whoever hears of a greater term leads no more, and begins another one later") {
    One one(1);
    REQUIRE(one.after(2600ms) == Change::begins_to_lead);
    const std::uint64_t later = one.membership.term().counter + 600;
    one.membership.learn({later, broker_of(9)}); // a worker has heard of it
    CHECK(one.after(0s) == Change::leads_no_more);
    CHECK(one.after(1299ms) == Change::none);
    CHECK(one.after(1ms) == Change::begins_to_lead);
    CHECK(one.membership.term().counter > later);
    CHECK(one.membership.term().leader == broker_of(1));
    one.membership.learn({UINT64_MAX, broker_of(9)}); // nothing is above that: it is rubbish
    CHECK(one.after(0s) == Change::none);
}

TEST_CASE("limits: rumour_beats: a worker is believed of terms seldom, and of who is not heard") {
    One one(1);
    REQUIRE(one.after(2600ms) == Change::begins_to_lead);
    const protocol::Term own = one.membership.term();
    const auto hear_of = [&](std::uint64_t counter, const BrokerId& leader) {
        one.membership.learn_of_worker(one.now, {counter, leader}, 1u << 30);
        return one.membership.term();
    };
    one.meet(2);
    CHECK(hear_of(own.counter + 600, broker_of(2)) == own); // who would say so itself
    CHECK(hear_of(own.counter + 600, broker_of(1)) == own); // as this one knows best
    CHECK(hear_of((1u << 30) + 1, broker_of(9)) == own);    // rubbish
    const protocol::Term theirs{own.counter + 600, broker_of(9)};
    CHECK(hear_of(theirs.counter, theirs.leader) == theirs);
    CHECK(one.after(0s) == Change::leads_no_more);
    one.after(9s);
    CHECK(hear_of(theirs.counter + 600'000, broker_of(8)) == one.membership.term());
    CHECK(one.membership.term().leader != broker_of(8));
    one.after(1s);
    one.meet(2);
    CHECK(hear_of(theirs.counter + 600'000, broker_of(2)).leader != broker_of(2));
    one.after(9s); // and is not heard any more
    CHECK(hear_of(theirs.counter + 600'000, broker_of(2)).leader == broker_of(2));
}

TEST_CASE("of two terms with one counter one is greater, so that two leaders do not last") {
    One one(1);
    REQUIRE(one.after(2600ms) == Change::begins_to_lead);
    const std::uint64_t counter = one.membership.term().counter;
    one.membership.learn({counter, broker_of(0)});
    CHECK(one.after(0s) == Change::none);
    one.membership.learn({counter, broker_of(2)});
    CHECK(one.after(0s) == Change::leads_no_more);
}

TEST_CASE("limits: told_patience_beats") {
    const protocol::Term term{500, broker_of(1)};
    One two(2);
    two.meet(1, true, term);
    two.meet(3);
    // It has crashed: nobody has heard it later than this broker, by more than beats lie apart.
    two.membership.hear_of_leader(two.now + 650ms, term, 0s);
    CHECK(two.after(2600ms) == Change::begins_to_lead);

    One other(2);
    other.meet(1, true, term);
    other.meet(3);
    REQUIRE(other.after(2500ms) == Change::none);
    other.membership.hear_of_leader(other.now, {400, broker_of(3)}, 0s); // of another leader
    other.membership.hear_of_leader(other.now, term, 3251ms);            // too long ago
    other.membership.hear_of_leader(other.now, term, -1s);               // rubbish
    other.membership.hear_of_leader(other.now, term, 500ms);
    CHECK(other.after(2750ms) == Change::none);
    CHECK(other.after(1ms) == Change::begins_to_lead);
    // Who is told so of itself, or of one that it hears, goes by its own ears.
    other.membership.hear_of_leader(other.now, other.membership.term(), 0s);
    CHECK(other.after(0s) == Change::none);
    CHECK(other.membership.leader_silence(other.now) == Duration::max());
}

TEST_CASE("limits: workers_patience_beats") {
    One two(2);
    const auto tell = [&](bool has_workers) { // the first one's beat
        protocol::BrokerBeat beat = beat_of(1, true, {500, broker_of(1)});
        beat.leads = true;
        beat.has_workers = has_workers;
        two.membership.hear(two.now, beat);
    };
    const auto first_change_in = [&](Duration most) {
        const Instant begin = two.now;
        while (two.now < begin + most) {
            two.now = two.now + 250ms;
            tell(false);
            if (two.membership.update(two.now) != Change::none)
                break;
        }
        return two.now - begin;
    };
    two.meet(1, true, {500, broker_of(1)});
    CHECK(first_change_in(20s) == 20s); // nobody has any
    two.membership.note_workers(two.now, true);
    tell(true);
    CHECK(two.membership.leader_silence(two.now) == 0s);
    two.now = two.now + 5s;
    two.membership.note_workers(two.now, true);
    CHECK(two.membership.has_workers());
    CHECK(first_change_in(20s) == 2'250ms); // since its first beat without
    CHECK(two.membership.leads());
    REQUIRE(two.membership.passed_over(two.now));
    CHECK(two.membership.passed_over(two.now)->rank == rank_of(1));
    tell(true); // it has some again
    CHECK(two.after(0s) == Change::leads_no_more);
}

TEST_CASE("two that begin at once, as neither hears the other, begin terms of two counters") {
    One one(1), two(2);
    for (One* each : {&one, &two}) {
        each->meet(3, true, {500, broker_of(3)});
        (void)each->after(10s);
    }
    REQUIRE(one.membership.leads());
    REQUIRE(two.membership.leads());
    CHECK(one.membership.term().counter > 500);
    CHECK(two.membership.term().counter > 500);
    CHECK(one.membership.term().counter != two.membership.term().counter);
}

TEST_CASE("one that is held to be gone and was not is borne with for longer, and not for ever") {
    One one(2);
    one.after(2500ms);
    one.meet(1, true);
    const auto is_here_after = [&](Duration silence) {
        (void)one.after(silence);
        const bool is_here = one.membership.is_here(broker_of(1), one.now);
        one.membership.hear(one.now, broker_of(1));
        return is_here;
    };
    CHECK_FALSE(is_here_after(1400ms));
    CHECK(is_here_after(1400ms));
    CHECK_FALSE(is_here_after(2700ms));
    CHECK(is_here_after(2700ms));
    for (int beat = 0; beat < 60; ++beat)
        CHECK(is_here_after(1s));
    CHECK_FALSE(is_here_after(1400ms));
}

TEST_CASE("a broker that stood still counts that as nobody's silence") {
    One one(2);
    one.after(2500ms);
    one.meet(1);
    one.now = one.now + 1h;
    one.membership.forgive(1h);
    CHECK(one.after(0s) == Change::none);
    CHECK(one.membership.here(one.now).size() == 1);
}
