// Several brokers that stand for each other, and jobs that are checked: what of them counts where,
// and what becomes of a liar's tiles.
#include "tests/broker/fleet.hpp"

#include <chrono>
#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::broker;
using namespace fraja::protocol;
using namespace std::chrono_literals;

TEST_CASE("of a checked job a standby broker has what the one that leads has, and no more") {
    Fleet fleet(2);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 2);
    fleet.worker_arrives("v", 2, 2);
    const SubmitJob picture = Farm::checked(1, 4);
    (void)fleet.submit(0, "c", picture);
    fleet.pass(100ms);
    REQUIRE(fleet.render_one("w"));
    CHECK(fleet.state(0, picture.job)->done_count == 1);
    CHECK(fleet.state(1, picture.job)->done_count == 0);
    fleet.pass(3s);
    CHECK(fleet.state(1, picture.job)->done_count == 1);
    fleet.kill(0);
    fleet.pass(2s);
    for (int i = 0; i < 20; ++i) {
        fleet.render_one("w");
        fleet.render_one("v");
    }
    CHECK(fleet.state(1, picture.job)->phase == JobPhase::done);
    CHECK(fleet.state(1, picture.job)->checks.agreed == 4);
}

TEST_CASE("what a leader said in a term of before does not count for a checked job") {
    Fleet fleet(2);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 2);
    const SubmitJob picture = Farm::checked(1, 2);
    (void)fleet.submit(0, "c", picture);
    fleet.pass(1s);
    const std::uint64_t epoch = fleet.state(1, picture.job)->epoch;
    const auto tile = [&](std::size_t i, std::uint64_t sent_in) {
        const RenderTile& t = fleet.workers.at("w").has.at(i);
        return TileDone{.job = t.job,
                        .tile = t.tile,
                        .rect = t.rect,
                        .worker_name = "w",
                        .rays = {},
                        .worker = id_of<WorkerId>(1),
                        .epoch = sent_in,
                        .blobs = Farm::answer(t).blobs};
    };
    for (std::uint32_t i = 0; i < 2; ++i) {
        fleet.say(1, "broker 0", tile(i, epoch - 1));
        CHECK(fleet.state(1, picture.job)->done_count == i);
        fleet.say(1, "broker 0", tile(i, epoch));
        REQUIRE(fleet.state(1, picture.job)->done_count == i + 1);
    }
    JobRecord word =
        word_of(picture, {fleet.state(1, picture.job)->revision.counter + 1, fleet.nodes[0].id},
                JobPhase::done);
    word.done_count = 2;
    const auto says_that_it_is_done = [&](std::uint64_t sent_in) {
        word.epoch = sent_in;
        fleet.say(1, "broker 0", word);
    };
    const auto says_that_it_has_that = [&](std::uint64_t sent_in) {
        fleet.say(1, "broker 0", JobDigests{{{picture.job, word.revision, 1}}, sent_in});
    };
    const auto phase = [&] { return fleet.state(1, picture.job)->phase; };
    SUBCASE("its word of the end") {
        says_that_it_is_done(epoch - 1);
        CHECK(phase() != JobPhase::done);
        word.revision.counter += 1;
        says_that_it_is_done(epoch);
        CHECK(phase() == JobPhase::done);
    }
    SUBCASE("what it had") {
        says_that_it_is_done(epoch - 1);
        says_that_it_has_that(epoch - 1);
        CHECK(phase() != JobPhase::done);
        says_that_it_has_that(epoch);
        CHECK(phase() == JobPhase::done);
    }
}

TEST_CASE("what nobody has given a worker is checked, however few tiles are") {
    Fleet fleet(2);
    fleet.pass(4s);
    fleet.worker_arrives("liar", 1, 1);
    fleet.worker_arrives("v", 2, 1);
    fleet.worker_arrives("u", 3, 1);
    const SubmitJob picture = Farm::checked(1, 4, 1e-9);
    (void)fleet.submit(0, "c", picture);
    fleet.pass(100ms);
    REQUIRE(fleet.workers.at("liar").has.size() == 1);
    const RenderTile given = fleet.workers.at("liar").has.front();
    for (std::uint32_t i = 0; i < 4; ++i) {
        TileRendered forged = Farm::answer(given);
        forged.tile = TileIndex{i};
        forged.attempt = static_cast<AttemptNumber>(77'000'000 + i);
        forged.rect = {10 * i, 0, 10, 10};
        Bytes pixels(byte_count(forged.blobs));
        pixels.back() = std::byte{1};
        forged.blobs = {Blob(std::move(pixels))};
        fleet.say(0, "liar", forged);
    }
    CHECK(fleet.state(0, picture.job)->done_count == 4);
    CHECK(fleet.state(0, picture.job)->phase != JobPhase::done);
    for (int i = 0; i < 20; ++i) {
        fleet.pass(100ms);
        fleet.render_one("v");
        fleet.render_one("u");
    }
    REQUIRE(fleet.state(0, picture.job)->phase == JobPhase::done);
    REQUIRE(fleet.state(0, picture.job)->distrusted.size() == 1);
    CHECK(fleet.state(0, picture.job)->distrusted.front().worker == id_of<WorkerId>(1));
}

TEST_CASE("tiles of a worker that only another broker distrusts stay in what is done") {
    for (const double verify : {0.0, 1.0}) {
        CAPTURE(verify);
        Fleet fleet(2);
        fleet.pass(4s);
        fleet.worker_arrives("w", 1, 1);
        SubmitJob picture = Farm::picture(1, 4);
        picture.wishes.verify = verify;
        (void)fleet.submit(0, "c", picture);
        fleet.pass(100ms);
        CHECK(fleet.render_one("w"));
        CHECK(fleet.render_one("w"));
        fleet.pass(5s);
        REQUIRE(fleet.state(1, picture.job)->done_count == 2);
        fleet.cut(0, 1);
        const JobRecord word = word_of(picture, fleet.state(1, picture.job)->revision,
                                       JobPhase::running, {{id_of<WorkerId>(1), "w", "it lies"}});
        fleet.say(1, "broker 0", word);
        CHECK(fleet.state(1, picture.job)->done_count == 0);
        CHECK(fleet.state(1, picture.job)->distrusted == word.distrusted);
        fleet.render_all("w");
        REQUIRE(fleet.state(0, picture.job)->phase == JobPhase::done); // its client has the picture
        fleet.pass(3s);
        fleet.heal();
        fleet.pass(9s);
        for (std::size_t i = 0; i < 2; ++i) {
            CAPTURE(i);
            CHECK(fleet.state(i, picture.job)->phase == JobPhase::done);
            CHECK(fleet.state(i, picture.job)->done_count == 4);
            CHECK(fleet.state(i, picture.job)->distrusted.empty()); // or its clients would wait
        }
    }
}

TEST_CASE("what was checked and is done belongs to its epoch until a later leader has it as well") {
    Fleet fleet(3);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 1);
    const SubmitJob picture = Farm::checked(1, 2);
    (void)fleet.submit(0, "c", picture);
    fleet.pass(1s);
    fleet.cut(1, 0);
    fleet.cut(1, 2);
    fleet.pass(9s);
    for (int i = 0; i < 9 && fleet.state(2, picture.job)->phase != JobPhase::done; ++i) {
        fleet.render_all("w");
        fleet.pass(1s);
    }
    REQUIRE(fleet.state(2, picture.job)->phase == JobPhase::done);
    REQUIRE(fleet.state(1, picture.job)->phase != JobPhase::done);
    const std::uint64_t before = fleet.state(2, picture.job)->epoch;
    fleet.kill(0);
    fleet.heal();
    bool waited = false;
    for (int i = 0; i < 400; ++i) {
        fleet.pass(25ms);
        const JobState leader = *fleet.state(1, picture.job), other = *fleet.state(2, picture.job);
        REQUIRE(other.phase == JobPhase::done);
        if (leader.phase != JobPhase::done) {
            CHECK(other.epoch == before);
            waited = waited || leader.epoch > before;
        }
    }
    CHECK(waited);
    CHECK(fleet.state(1, picture.job)->phase == JobPhase::done);
    CHECK(fleet.state(2, picture.job)->epoch == fleet.state(1, picture.job)->epoch);
}

TEST_CASE("of two ends of a checked job nobody is told that more was checked than was") {
    Fleet fleet(2);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 1);
    fleet.worker_arrives("v", 2, 1);
    const SubmitJob picture = Farm::checked(1, 2);
    (void)fleet.submit(0, "c", picture);
    fleet.pass(100ms);
    for (int i = 0; i < 9; ++i) {
        fleet.render_one("w");
        fleet.render_one("v");
    }
    fleet.pass(3s);
    for (std::size_t i = 0; i < 2; ++i) {
        REQUIRE(fleet.state(i, picture.job)->phase == JobPhase::done);
        REQUIRE(fleet.state(i, picture.job)->checks.unchecked == 0);
    }
    const std::uint64_t before = fleet.state(0, picture.job)->revision.counter;
    const auto epoch = [&] { return fleet.state(1, picture.job)->epoch; };
    const auto word_of_end = [&](std::size_t teller, std::uint32_t unchecked) {
        const Revision revision{fleet.state(0, picture.job)->revision.counter + 1,
                                fleet.nodes[teller].id};
        JobRecord word = word_of(picture, revision, JobPhase::done);
        word.done_count = 2;
        word.checks = {2 - unchecked, unchecked};
        word.epoch = epoch();
        return word;
    };
    SUBCASE("the one that leads tells again of its own") {
        fleet.say(0, "broker 1", word_of_end(1, 1));
        CHECK(fleet.state(0, picture.job)->revision.counter == before + 2);
        CHECK(fleet.state(0, picture.job)->checks.unchecked == 0);
    }
    SUBCASE("another one tells the worse of both, if that is the leader's") {
        fleet.say(1, "broker 0", word_of_end(0, 1));
        CHECK(fleet.state(1, picture.job)->checks.unchecked == 1);
    }
    SUBCASE("or says that its own is of an epoch before") {
        fleet.say(1, "broker 0", word_of_end(0, 1)); // as if it had come to that by itself
        fleet.cut(0, 1);
        const std::uint64_t own = epoch();
        fleet.say(1, "broker 0", word_of_end(0, 0));
        CHECK(fleet.state(1, picture.job)->checks.unchecked == 1);
        CHECK(epoch() == own);
    }
}

TEST_CASE("tiles of a worker that is distrusted go from a job that was cancelled as well") {
    Fleet fleet(2);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 1);
    const SubmitJob picture = Farm::picture(1, 4);
    (void)fleet.submit(0, "c", picture);
    fleet.pass(100ms);
    CHECK(fleet.render_one("w"));
    CHECK(fleet.render_one("w"));
    fleet.pass(1s);
    fleet.say(0, "c", ControlJob{picture.job, JobDeed::cancel, 0});
    fleet.pass(1s);
    REQUIRE(fleet.state(1, picture.job)->phase == JobPhase::cancelled);
    REQUIRE(fleet.state(1, picture.job)->done_count == 2);
    fleet.say(1, "broker 0",
              word_of(picture, fleet.state(1, picture.job)->revision, JobPhase::cancelled,
                      {{id_of<WorkerId>(1), "w", "it lies"}}));
    CHECK(fleet.state(1, picture.job)->phase == JobPhase::cancelled);
    CHECK(fleet.state(1, picture.job)->done_count == 0);
    fleet.pass(3s); // and the other one hears of it
    CHECK(fleet.state(0, picture.job)->done_count == 0);
    fleet.worker_arrives("v", 2, 1);
    fleet.say(0, "c", ControlJob{picture.job, JobDeed::retry, 0});
    fleet.pass(1s);
    fleet.render_all("v");
    fleet.pass(3s);
    for (std::size_t i = 0; i < 2; ++i) {
        CHECK(fleet.state(i, picture.job)->phase == JobPhase::done);
        CHECK(fleet.state(i, picture.job)->done_count == 4);
        CHECK(fleet.state(i, picture.job)->distrusted.size() == 1);
    }
}

TEST_CASE("what nobody could check is checked after all, as long as the job is not through") {
    Fleet fleet(2);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 2);
    const SubmitJob picture = Farm::checked(1, 2);
    (void)fleet.submit(0, "c", picture);
    fleet.pass(100ms);
    fleet.liar = "l";
    fleet.worker_arrives("l", 2, 1);
    fleet.render_all("w");
    fleet.pass(100ms);
    REQUIRE(fleet.render_one("l")); // nobody can tell who is right, and the other tile
    fleet.workers.erase("l");       // is checked by nobody
    for (std::size_t i = 0; i < 2; ++i)
        fleet.say(i, "l", Goodbye{});
    for (int i = 0; i < 9; ++i) {
        fleet.pass(1s);
        fleet.render_all("w");
    }
    REQUIRE(fleet.state(0, picture.job)->done_count == 2);
    REQUIRE_FALSE(is_over(fleet.state(0, picture.job)->phase));
    SUBCASE("it goes on") {}
    SUBCASE("it is cancelled, and tried again") {
        fleet.say(1, "c", ControlJob{picture.job, JobDeed::cancel, 0});
        fleet.pass(1s);
        REQUIRE(fleet.state(0, picture.job)->phase == JobPhase::cancelled);
        fleet.say(0, "c", ControlJob{picture.job, JobDeed::retry, 0});
    }
    fleet.worker_arrives("v", 3, 1);
    for (int i = 0; i < 9; ++i) {
        fleet.pass(1s);
        fleet.render_all("v");
        fleet.render_all("w");
    }
    for (std::size_t i = 0; i < 2; ++i) {
        CHECK(fleet.state(i, picture.job)->phase == JobPhase::done);
        CHECK(fleet.state(i, picture.job)->checks.agreed == 2);
        CHECK(fleet.state(i, picture.job)->checks.unchecked == 0);
    }
}

TEST_CASE("what an earlier leader had not checked goes from what was cancelled as well") {
    Fleet fleet(3);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 1);
    const SubmitJob picture = Farm::checked(1, 4);
    (void)fleet.submit(0, "c", picture);
    for (std::size_t i = 0; i < 3; ++i)
        fleet.event(i, TopicSubscribed{job_topic(picture.job)});
    fleet.pass(100ms);
    REQUIRE(fleet.render_one("w"));
    fleet.pass(3s);
    fleet.say(0, "c", ControlJob{picture.job, JobDeed::cancel, 0});
    fleet.pass(1s);
    for (std::size_t i = 0; i < 3; ++i) {
        REQUIRE(fleet.state(i, picture.job)->phase == JobPhase::cancelled);
        REQUIRE(fleet.state(i, picture.job)->done_count == 1);
    }
    fleet.kill(0);
    fleet.pass(5s);
    REQUIRE(fleet.leaders().size() == 1);
    const std::size_t leads = fleet.leaders()[0], follows = 3 - leads;
    CHECK(fleet.published(leads, picture.job) == 1);
    CHECK(fleet.published(follows, picture.job) == 2); // it has gone, and come from there
    for (std::size_t i = 1; i < 3; ++i)
        CHECK(fleet.state(i, picture.job)->done_count == 1);
}

TEST_CASE("a liar's tiles go from what was to end with them, and goes on here after all") {
    Fleet fleet(2);
    fleet.pass(4s);
    fleet.worker_arrives("w", 1, 1);
    const SubmitJob picture = Farm::picture(1, 4);
    SubmitJob other = Farm::picture(2, 4);
    (void)fleet.submit(0, "c", picture);
    (void)fleet.submit(0, "c", other);
    fleet.pass(100ms);
    REQUIRE(fleet.render_one("w"));
    fleet.pass(2s);
    REQUIRE(fleet.state(1, picture.job)->done_count + fleet.state(1, other.job)->done_count == 1);
    const bool is_first = fleet.state(1, picture.job)->done_count == 1;
    const SubmitJob &ended = is_first ? picture : other, &found_in = is_first ? other : picture;
    fleet.cut(0, 1);
    JobRecord word = word_of(ended, {9, fleet.nodes[0].id}, JobPhase::done);
    word.done_count = 4; // of which the others do not come
    word.epoch = fleet.state(1, picture.job)->epoch;
    fleet.say(1, "broker 0", word);
    fleet.say(1, "broker 0",
              word_of(found_in, {9, fleet.nodes[0].id}, JobPhase::running,
                      {{id_of<WorkerId>(1), "w", "it lies"}}));
    CHECK(fleet.state(1, ended.job)->done_count == 1); // as it was told
    fleet.kill(0);
    fleet.pass(9s);
    REQUIRE(fleet.leaders() == std::vector<std::size_t>{1});
    CHECK(fleet.state(1, ended.job)->done_count == 0);
    CHECK(fleet.state(1, ended.job)->distrusted.size() == 1);
    fleet.worker_arrives("v", 2, 1);
    fleet.pass(1s);
    fleet.render_all("v");
    fleet.pass(1s);
    CHECK(fleet.state(1, ended.job)->phase == JobPhase::done);
    CHECK(fleet.state(1, found_in.job)->phase == JobPhase::done);
}

TEST_CASE("a worker whose tiles are in what is done is trusted again in the store, too") {
    Fleet fleet(2, {}, true);
    fleet.pass(4s);
    const SubmitJob picture = Farm::picture(1, 4);
    (void)fleet.submit(0, "c", picture);
    fleet.pass(1s);
    const WorkerId worker = id_of<WorkerId>(1);
    JobRecord word =
        word_of(picture, {7, fleet.nodes[0].id}, JobPhase::running, {{worker, "w", "it lies"}});
    fleet.say(1, "broker 0", word);
    REQUIRE(fleet.state(1, picture.job)->distrusted.size() == 1);
    word.revision.counter = 8;
    word.phase = JobPhase::done;
    word.done_count = 4;
    SUBCASE("its teller distrusts it") {}
    SUBCASE("its teller does not") {
        word.distrusted.clear();
    }
    fleet.say(1, "broker 0", word);
    CHECK(fleet.state(1, picture.job)->distrusted == word.distrusted);
    const auto trusts_it = [&](const Write& write) {
        const auto* trusted = std::get_if<PutTrusted>(&write);
        return trusted && trusted->worker == worker;
    };
    CHECK(std::ranges::any_of(fleet.nodes[1].kept, trusts_it) == word.distrusted.empty());
}

TEST_CASE("a job that comes to its end by itself follows what another broker has said of that") {
    for (const bool is_paused : {false, true}) {
        CAPTURE(is_paused);
        Fleet fleet(2);
        fleet.pass(4s);
        fleet.worker_arrives("w", 1, 8);
        fleet.worker_arrives("v", 2, 1);
        const SubmitJob picture = Farm::checked(1, 4);
        (void)fleet.submit(0, "c", picture);
        fleet.pass(100ms);
        for (fleet.render_all("w"); fleet.state(0, picture.job)->done_count < 4;
             fleet.render_all("w"))
            fleet.render_one("v");
        REQUIRE(fleet.state(0, picture.job)->phase != JobPhase::done); // v is to check
        if (is_paused) // and somebody resumed it where it was done
            fleet.say(0, "c", ControlJob{picture.job, JobDeed::pause, 0});
        JobRecord word = word_of(picture, {9, fleet.nodes[1].id}, JobPhase::done);
        word.done_count = 4;
        fleet.say(0, "broker 1", word);
        fleet.pass(1s);
        CHECK(fleet.state(0, picture.job)->revision != word.revision); // it is not done here
        CHECK(fleet.state(0, picture.job)->phase != JobPhase::paused);
        fleet.workers.erase("v");
        for (std::size_t i = 0; i < 2; ++i)
            fleet.say(i, "v", Goodbye{});
        fleet.pass(3s);
        CHECK(fleet.state(0, picture.job)->phase == JobPhase::done);
        CHECK_FALSE(fleet.state(0, picture.job)->revision < word.revision);
    }
}
