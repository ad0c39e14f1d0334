// What is kept in the store, and what a broker makes of what it finds there.
#include "tests/broker/farm.hpp"

namespace fraja::broker {
namespace {

using namespace protocol;
using namespace std::chrono_literals;

template <class W>
std::vector<W> written(const Farm& farm) {
    std::vector<W> result;
    for (const Persist& persist : farm.persisted)
        if (const auto* write = std::get_if<W>(&persist.write))
            result.push_back(*write);
    return result;
}

void all_stored(Farm& farm) {
    if (!farm.persisted.empty())
        farm.event(Stored{farm.persisted.back().sequence});
}

/// As it is in the store.
StoredJob stored(std::uint8_t id, std::uint32_t columns, std::uint32_t done) {
    StoredJob job;
    job.submission = Farm::picture(id, columns);
    job.number = id;
    job.phase = JobPhase::queued;
    job.age = 1min;
    for (std::uint32_t i = 0; i < done; ++i) {
        StoredTile tile;
        tile.tile = TileIndex{i};
        tile.rect = {10 * i, 0, 10, 10};
        tile.rays.camera = 100;
        tile.elapsed = 5ms;
        job.tiles.push_back(tile);
    }
    return job;
}

Restored restored(std::vector<StoredJob> jobs) {
    Restored event;
    for (StoredJob& job : jobs) {
        event.contents.last_number = std::max(event.contents.last_number, job.number);
        event.contents.jobs.push_back(std::move(job));
    }
    event.scenes[scene_hash] = scene_bytes;
    return event;
}

TEST_CASE("a job is acknowledged when it is in the store, and not before") {
    Farm farm({}, true);
    farm.worker_arrives("w", 1, 1, 1);
    farm.client_arrives("c");
    farm.say("c", Farm::picture(1, 2));
    farm.say("c", Farm::scene_chunk());
    CHECK(farm.last<JobState>("c").phase == JobPhase::waiting_for_scene);
    CHECK(farm.tiles("w").empty());
    REQUIRE(farm.persisted.size() == 2);
    CHECK(std::get<PutBlob>(farm.persisted[0].write).hash == scene_hash);
    CHECK(std::get<PutJob>(farm.persisted[1].write).number == 1);
    farm.pass(300s); // the disk is slow, and that is not the client's fault
    farm.worker_arrives("w", 1, 1, 1);
    farm.client_arrives("c");
    farm.say("c", Farm::picture(1, 2)); // it asks once more
    CHECK(farm.last<JobState>("c").phase == JobPhase::waiting_for_scene);
    CHECK(farm.persisted.size() == 2);
    farm.event(Stored{farm.persisted[0].sequence});
    CHECK(farm.last<JobState>("c").phase == JobPhase::waiting_for_scene);
    farm.event(Stored{farm.persisted[1].sequence});
    CHECK(farm.last<JobState>("c").phase == JobPhase::queued);
    CHECK(farm.tiles("w").size() == 1);
}

TEST_CASE("a tile is published at once, kept, and then sent from the store") {
    Farm farm({}, true);
    farm.worker_arrives("w", 1, 1, 1);
    const SubmitJob picture = Farm::picture(1, 2);
    farm.subscribe(picture.job);
    farm.submit("client", picture);
    all_stored(farm);
    farm.render("w", farm.tiles("w").at(0));
    CHECK(farm.published<TileDone>(job_topic(picture.job)).size() == 1);
    REQUIRE(written<PutTile>(farm).size() == 1);
    const auto ask = [&] {
        farm.forget("client");
        farm.say("client", Repair{picture.job, 9, {}});
        return farm.all<TileDone>("client").size();
    };
    CHECK(ask() == 1); // it is still here
    all_stored(farm);
    CHECK(ask() == 0);
    REQUIRE(farm.from_store.size() == 1);
    CHECK(farm.from_store[0].tiles == std::vector{TileIndex{0}});
    CHECK(farm.last<RepairDone>("client").remaining_count == 0);
}

TEST_CASE("what people decide is kept: phases, priorities, and that a job is forgotten") {
    Limits limits;
    limits.keep = 1h;
    Farm farm(limits, true);
    const JobId job = farm.submit(1, 2);
    all_stored(farm);
    farm.say("client", ControlJob{job, JobDeed::set_priority, 4});
    farm.say("client", ControlJob{job, JobDeed::pause, 0});
    farm.say("client", ControlJob{job, JobDeed::cancel, 0});
    CHECK(written<PutPriority>(farm).at(0).priority == 4);
    CHECK(written<PutPhase>(farm).at(0).phase == JobPhase::paused);
    CHECK(written<PutPhase>(farm).at(1).phase == JobPhase::cancelled);
    farm.pass(59min);
    CHECK(written<ForgetJob>(farm).empty());
    farm.pass(2min);
    CHECK(written<ForgetJob>(farm).at(0).job == job);
    farm.client_arrives("client");
    farm.say("client", Farm::picture(1, 2));
    CHECK(farm.last<Refused>("client").code == RefusalCode::conflict);
}

TEST_CASE("a broker goes on with what it finds, and renders nothing again") {
    Farm farm({}, true);
    farm.event(restored({stored(3, 5, 2)}));
    const JobState state = farm.state(id_of<JobId>(3));
    CHECK(state.number == 3);
    CHECK(state.phase == JobPhase::queued);
    CHECK(state.done_count == 2);
    CHECK(state.rays.camera == 200);
    CHECK(state.elapsed == 1min);
    farm.worker_arrives("w", 1, 1, 9);
    const auto tiles = farm.tiles("w");
    REQUIRE(tiles.size() == 3);
    for (const auto& tile : tiles) {
        CHECK(tile.rect.x >= 20);
        farm.say("w", NeedChunk{scene_hash, 0});
        farm.render("w", tile);
    }
    CHECK(farm.heard<Chunk>("w"));
    CHECK(farm.state(id_of<JobId>(3)).phase == JobPhase::done);
    CHECK(farm.submit(9, 1) == id_of<JobId>(9));
    all_stored(farm);
    CHECK(farm.state(id_of<JobId>(9)).number == 4); // numbers go on
}

TEST_CASE("whatever a job was when its broker died, it is that again") {
    StoredJob done = stored(1, 2, 2), paused = stored(2, 2, 1), failed = stored(3, 2, 1),
              ended = stored(4, 2, 2), bare = stored(5, 2, 1);
    done.phase = JobPhase::done;
    done.elapsed = 7s;
    done.over_for = 10s;
    paused.phase = JobPhase::paused;
    failed.phase = JobPhase::failed;
    failed.reason = "why";
    failed.over_for = 10s;
    bare.submission.scene.bytes[0] ^= 1; // its scene is gone
    Farm farm({}, true);
    farm.event(restored({done, paused, failed, ended, bare}));
    farm.worker_arrives("w", 1, 1, 9);
    CHECK(farm.tiles("w").empty());
    const auto state = [&](std::uint8_t id) { return farm.state(id_of<JobId>(id)); };
    CHECK(state(1).phase == JobPhase::done);
    CHECK(state(1).elapsed == 7s);
    CHECK(state(2).phase == JobPhase::paused);
    CHECK(state(3).phase == JobPhase::failed);
    CHECK(state(3).reason == "why");
    CHECK(state(4).phase == JobPhase::done); // all was there but the word
    CHECK(state(5).phase == JobPhase::failed);
    CHECK(state(5).reason.find("scene") != std::string::npos);
}

TEST_CASE("after a restart the tiles of another broker's job are waited for as before") {
    StoredJob partial = stored(1, 2, 1);
    partial.phase = JobPhase::paused;
    partial.submission.scene.bytes[0] ^= 1; // it has none
    Farm farm({}, true);
    farm.event(restored({partial}));
    farm.pass(farm.limits.partial_copy_patience);
    CHECK(farm.state(partial.submission.job).done_count == 1);
    farm.pass(2s);
    farm.client_arrives("c");
    farm.say("c", FindJob{to_string(partial.submission.job)});
    CHECK(farm.last<Refused>("c").code == RefusalCode::no_such_job);
}

TEST_CASE("a job that was over is tried again with its scene from the store") {
    StoredJob failed = stored(1, 2, 1);
    failed.phase = JobPhase::failed;
    failed.over_for = 10s;
    Farm farm({}, true);
    farm.event(restored({failed}));
    farm.client_arrives("c");
    farm.say("c", ControlJob{id_of<JobId>(1), JobDeed::retry, 0});
    REQUIRE(farm.scenes_wanted.size() == 1);
    farm.event(SceneLoaded{id_of<JobId>(1), "c", scene_bytes});
    CHECK(farm.last<JobState>("c").phase == JobPhase::queued);
    farm.worker_arrives("w", 1, 1, 9);
    CHECK(farm.tiles("w").size() == 1);
    farm.event(SceneLoaded{id_of<JobId>(1), "c", std::nullopt}); // nobody asked
    CHECK(farm.state(id_of<JobId>(1)).phase == JobPhase::running);
}

TEST_CASE("a job whose scene comes from the store begins, though its client is still sending it") {
    StoredJob failed = stored(1, 2, 1);
    failed.phase = JobPhase::failed;
    failed.over_for = 10s;
    Farm farm({}, true);
    farm.event(restored({failed}));
    farm.client_arrives("c");
    farm.say("c", Farm::picture(2, 1)); // of the same scene
    CHECK(farm.heard<NeedChunk>("c"));
    farm.say("c", ControlJob{id_of<JobId>(1), JobDeed::retry, 0});
    farm.event(SceneLoaded{id_of<JobId>(1), "c", scene_bytes});
    all_stored(farm);
    CHECK(farm.state(id_of<JobId>(2)).phase == JobPhase::queued);
}

TEST_CASE("a job of which nothing was drawn is probed by the next broker") {
    for (const std::uint32_t done : {0u, 1u}) {
        StoredJob job = stored(1, 20, 0);
        job.submission.tile_side = 0;
        job.submission.settings.size = {256, 192};
        job.submission.settings.crop = {0, 0, 256, 192};
        if (done > 0)
            job.tiles = {{.tile = {}, .frame = 0, .pass = 0, .rect = {0, 0, 32, 32}, .rays = {}}};
        Farm farm({}, true);
        farm.event(restored({job}));
        farm.worker_arrives("w", 1, 1, 1);
        CHECK((farm.tiles("w").at(0).probe_side > 0) == (done == 0));
    }
}

TEST_CASE("a time limit goes on counting while there is no broker") {
    StoredJob job = stored(1, 2, 0);
    job.submission.settings.time_limit = 2min;
    job.passes = 3;
    Farm farm({}, true);
    farm.event(restored({job}));
    CHECK(farm.dispatcher.next_deadline() <= farm.now + 1min);
}

TEST_CASE("while nothing can be kept nothing is handed out, and everybody is told why") {
    Farm farm({}, true);
    farm.worker_arrives("w", 1, 1, 1);
    const SubmitJob picture = Farm::picture(1, 3);
    farm.subscribe(picture.job);
    farm.submit("client", picture);
    all_stored(farm);
    const auto tile = farm.tiles("w").at(0);
    farm.event(StoreFails{"the disk is full"});
    farm.render("w", tile); // what is done is not lost
    CHECK(farm.tiles("w").empty());
    const JobState state = farm.published<JobState>(job_topic(picture.job)).back();
    CHECK(state.reason.find("the disk is full") != std::string::npos);
    CHECK_FALSE(is_over(state.phase));
    farm.say("client", Farm::picture(2, 1));
    CHECK(farm.last<Refused>("client").code == RefusalCode::limit_exceeded);
    CHECK(farm.last<Refused>("client").reason.find("the disk is full") != std::string::npos);
    farm.event(StoreWorks{});
    CHECK(farm.tiles("w").size() == 1);
    CHECK(farm.state(picture.job).reason.empty());
    CHECK(farm.state(picture.job).done_count == 1);
}

TEST_CASE("a broker that cannot keep anything waits, though a worker is idle") {
    Farm farm({}, true);
    farm.worker_arrives("a", 1, 1, 1);
    farm.worker_arrives("b", 2, 1, 1);
    farm.submit(1, 3);
    all_stored(farm);
    const auto tile = farm.tiles("a").at(0);
    farm.now = farm.now + 300ms;
    farm.event(StoreFails{"the disk is full"});
    farm.render("a", tile);
    farm.event(Tick{});
    CHECK(farm.tiles("a").empty());
    CHECK(farm.dispatcher.next_deadline() > farm.now);
}

TEST_CASE("beyond unstored_writes_max people's wishes are refused, but for an end") {
    Farm farm(Limits{.unstored_writes_max = 10}, true);
    const JobId job = farm.submit(1, 3);
    all_stored(farm);
    farm.event(StoreFails{"the disk is full"});
    const auto want = [&](JobDeed deed) {
        farm.forget("client");
        farm.say("client", ControlJob{job, deed, 1});
        return !farm.heard<Refused>("client");
    };
    int granted = 0;
    while (granted < 100 && want(JobDeed::set_priority))
        ++granted;
    CHECK(granted == 10);
    CHECK(farm.last<Refused>("client").reason.find("the disk is full") != std::string::npos);
    CHECK_FALSE(want(JobDeed::pause));
    const auto written = farm.persisted.size();
    CHECK(want(JobDeed::cancel));
    CHECK(farm.persisted.size() == written + 1);
    CHECK_FALSE(want(JobDeed::retry));
    all_stored(farm);
    CHECK(want(JobDeed::retry));
}

TEST_CASE("a store that is too slow holds up the farm beyond unstored_bytes_max") {
    Limits limits;
    limits.unstored_bytes_max = 5'000;
    Farm farm(limits, true);
    farm.worker_arrives("w", 1, 1, 1);
    farm.submit(1, 50);
    all_stored(farm);
    int handed = 0;
    for (auto tiles = farm.tiles("w"); !tiles.empty(); tiles = farm.tiles("w")) {
        ++handed;
        farm.render("w", tiles.at(0));
    }
    CHECK(handed > 1);
    CHECK(handed < 10);
    all_stored(farm);
    CHECK(farm.tiles("w").size() == 1);
}

} // namespace
} // namespace fraja::broker
