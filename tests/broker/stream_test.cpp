#include "tests/broker/farm.hpp"

using namespace fraja;
using namespace fraja::broker;
using namespace fraja::protocol;
using namespace std::chrono_literals;

namespace {

/// A farm with a job of 6 tiles of which `done` are finished.
JobId job_with_done(Farm& farm, std::size_t done) {
    const JobId job = farm.submit(1, 6);
    farm.worker_arrives("w", 1, 6, 6);
    const auto tiles = farm.tiles("w");
    for (std::size_t i = 0; i < done; ++i)
        farm.render("w", tiles[i]);
    return job;
}

} // namespace

TEST_CASE("a barrier is echoed to its nonce") {
    Farm farm;
    const auto nonce = id_of<Nonce>(5);
    farm.event(TopicSubscribed{barrier_topic(nonce)});
    const auto barriers = farm.published<Barrier>(barrier_topic(nonce));
    REQUIRE(barriers.size() == 1);
    CHECK(barriers[0].nonce == nonce);
    CHECK(barriers[0].epoch == 7);
}

TEST_CASE("repair sends what is missing and says what is left") {
    Farm farm;
    const JobId job = job_with_done(farm, 5);
    Bitmap have(6);
    have.set(1);
    farm.say("client", Repair{job, 3, have.bytes()});
    auto sent = farm.all<TileDone>("client");
    REQUIRE(sent.size() == 3);
    CHECK(sent[0].tile == TileIndex{0});
    CHECK(sent[1].tile == TileIndex{2});
    CHECK(farm.last<RepairDone>("client").remaining_count == 1);
    CHECK(farm.last<RepairDone>("client").state.done_count == 5);
    for (const auto& tile : sent)
        have.set(static_cast<std::size_t>(tile.tile));
    farm.forget("client");
    farm.say("client", Repair{job, 3, have.bytes()});
    CHECK(farm.all<TileDone>("client").size() == 1);
    CHECK(farm.last<RepairDone>("client").remaining_count == 0);
    farm.say("client", Repair{id_of<JobId>(88), 3, {}});
    CHECK(farm.last<Refused>("client").code == RefusalCode::no_such_job);
}

TEST_CASE("digests go out ten times a second while somebody listens") {
    Farm farm;
    const JobId job = job_with_done(farm, 2);
    farm.pass(1s);
    CHECK(farm.published<JobState>(job_topic(job)).empty()); // nobody listens
    farm.subscribe(job);
    farm.stream.clear();
    farm.pass(1s);
    const auto digests = farm.published<JobState>(job_topic(job));
    CHECK(digests.size() >= 9);
    CHECK(digests.size() <= 11);
    CHECK(digests.back().done_count == 2);
    farm.event(TopicUnsubscribed{job_topic(job)});
    farm.stream.clear();
    farm.pass(1s);
    CHECK(farm.stream.empty());
}

TEST_CASE("digests go on for a while after the end and then stop") {
    Farm farm;
    const JobId job = job_with_done(farm, 6);
    farm.subscribe(job);
    farm.pass(1s);
    CHECK(farm.published<JobState>(job_topic(job)).size() >= 9);
    farm.pass(10s);
    farm.stream.clear();
    farm.pass(2s);
    CHECK(farm.stream.empty());
}

TEST_CASE("the state of the farm is published while somebody listens") {
    Farm farm;
    job_with_done(farm, 3);
    farm.event(TopicSubscribed{std::string(farm_topic)});
    farm.pass(1s);
    const auto states = farm.published<FarmState>(std::string(farm_topic));
    REQUIRE(states.size() >= 2);
    REQUIRE(states.back().workers.size() == 1);
    CHECK(states.back().workers[0].tiles_done == 3);
    REQUIRE(states.back().jobs.size() == 1);
    CHECK(states.back().jobs[0].done_count == 3);
}

TEST_CASE("limits: digest_interval, digest_tail, farm_interval") {
    Limits limits;
    limits.digest_interval = 200ms;
    limits.digest_tail = 1s;
    limits.farm_interval = 250ms;
    Farm farm(limits);
    const JobId job = job_with_done(farm, 6);
    farm.subscribe(job);
    farm.pass(3s);
    const std::size_t digests = farm.published<JobState>(job_topic(job)).size();
    CHECK(digests >= 4);
    CHECK(digests <= 6);
    farm.event(TopicSubscribed{std::string(farm_topic)});
    farm.pass(1s);
    const std::size_t states = farm.published<FarmState>(std::string(farm_topic)).size();
    CHECK(states >= 4);
    CHECK(states <= 5);
}

TEST_CASE("topics that make no sense are ignored") {
    Farm farm;
    for (const char* topic : {"", "x", "J", "Jshort", "N", "Fx"}) {
        farm.event(TopicSubscribed{topic});
        farm.event(TopicUnsubscribed{topic});
    }
    CHECK(farm.stream.empty());
}
