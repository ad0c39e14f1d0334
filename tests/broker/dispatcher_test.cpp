#include "tests/broker/farm.hpp"

using namespace fraja;
using namespace fraja::broker;
using namespace fraja::protocol;
using namespace std::chrono_literals;

TEST_CASE("a worker is welcomed and gets tiles up to its credit") {
    Farm farm;
    farm.worker_arrives("w", 1, 2, 4);
    CHECK(farm.last<Welcome>("w").epoch == 7);
    CHECK(farm.last<Welcome>("w").stream == "tcp://127.0.0.1:50058");
    const JobId job = farm.submit(1, 10);
    const auto tiles = farm.tiles("w");
    REQUIRE(tiles.size() == 4);
    CHECK(tiles[0].rect == PixelRect{0, 0, 10, 10});
    CHECK(tiles[0].scene == scene_hash);
    CHECK(tiles[0].attempt == AttemptNumber{1});
    CHECK(farm.state(job).phase == JobPhase::running);
    farm.render("w", tiles[2]); // any order
    CHECK(farm.tiles("w").size() == 1);
}

TEST_CASE("a job is done when every tile is and its tiles are published once each") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 2);
    const SubmitJob picture = Farm::picture(1, 5);
    farm.subscribe(picture.job);
    farm.submit("client", picture);
    for (auto tiles = farm.tiles("w"); !tiles.empty(); tiles = farm.tiles("w"))
        for (const auto& tile : tiles) {
            farm.now = farm.now + 5ms;
            farm.render("w", tile);
        }
    const auto state = farm.state(picture.job);
    CHECK(state.phase == JobPhase::done);
    CHECK(state.done_count == 5);
    CHECK(state.rays.camera == 500);
    CHECK(state.render_time == 25ms);
    std::set<TileIndex> seen;
    for (const auto& tile : farm.published<TileDone>(job_topic(picture.job))) {
        CHECK(seen.insert(tile.tile).second);
        CHECK(tile.worker_name == "w");
        CHECK(tile.blobs.front().size() == 1200);
    }
    CHECK(seen.size() == 5);
    CHECK(farm.published<JobState>(job_topic(picture.job)).back().phase == JobPhase::done);
}

TEST_CASE("the least loaded worker is served first") {
    Farm farm;
    farm.worker_arrives("big", 1, 8, 16);
    farm.worker_arrives("small", 2, 1, 2);
    farm.submit(1, 9);
    CHECK(farm.tiles("big").size() == 8);
    CHECK(farm.tiles("small").size() == 1);
}

TEST_CASE("jobs of one priority share the farm and a higher one goes first") {
    Farm farm;
    farm.submit(1, 20);
    farm.submit(2, 20);
    farm.worker_arrives("w", 1, 4, 8);
    const auto tiles = farm.tiles("w");
    CHECK(std::ranges::count(tiles, id_of<JobId>(1), &RenderTile::job) == 4);
    CHECK(std::ranges::count(tiles, id_of<JobId>(2), &RenderTile::job) == 4);
    SubmitJob urgent = Farm::picture(3, 3);
    urgent.priority = 5;
    farm.submit("other", urgent);
    for (const auto& tile : tiles)
        farm.render("w", tile);
    const auto next = farm.tiles("w");
    REQUIRE(next.size() == 8);
    for (std::size_t i = 0; i < 3; ++i)
        CHECK(next[i].job == urgent.job);
}

TEST_CASE("submitting is idempotent and another job cannot take the id") {
    Farm farm;
    const SubmitJob picture = Farm::picture(1, 3);
    farm.submit("client", picture);
    farm.say("client", picture);
    CHECK(farm.last<JobState>("client").number == 1);
    CHECK(farm.dispatcher.job_count() == 1);
    SubmitJob other = picture;
    other.settings.depth = 9;
    farm.say("client", other);
    CHECK(farm.last<Refused>("client").code == RefusalCode::conflict);
}

TEST_CASE("the scene is asked for once and given to workers in chunks") {
    Farm farm;
    farm.client_arrives("a");
    farm.client_arrives("b");
    farm.say("a", Farm::picture(1, 3));
    CHECK(farm.all<NeedChunk>("a").size() == 1);
    CHECK(farm.last<JobState>("a").phase == JobPhase::waiting_for_scene);
    farm.say("b", Farm::picture(2, 3)); // the same scene: a is sending it
    CHECK_FALSE(farm.heard<NeedChunk>("b"));
    farm.say("a", Farm::scene_chunk());
    CHECK(farm.last<JobState>("a").phase == JobPhase::queued);
    CHECK(farm.last<JobState>("b").phase == JobPhase::queued);
    farm.say("b", Farm::picture(3, 3));
    CHECK_FALSE(farm.heard<NeedChunk>("b")); // the broker has it
    farm.worker_arrives("w", 1, 1, 1);
    farm.say("w", NeedChunk{scene_hash, 0});
    CHECK(farm.last<Chunk>("w").blobs.front() == Blob(scene_bytes));
    farm.say("w", NeedChunk{scene_hash, 4096});
    CHECK(farm.last<Refused>("w").code == RefusalCode::invalid);
}

TEST_CASE("a client that leaves while sending the scene fails its job and another one goes on") {
    Farm farm;
    farm.client_arrives("a");
    farm.client_arrives("b");
    farm.say("a", Farm::picture(1, 3));
    farm.say("b", Farm::picture(2, 3));
    farm.say("a", Goodbye{});
    CHECK(farm.state(id_of<JobId>(1)).phase == JobPhase::failed);
    REQUIRE(farm.heard<NeedChunk>("b"));
    farm.say("b", Farm::scene_chunk());
    CHECK(farm.state(id_of<JobId>(2)).phase == JobPhase::queued);
}

TEST_CASE("a client that comes back while sending the scene is asked again") {
    Farm farm;
    farm.client_arrives("a");
    farm.say("a", Farm::picture(1, 3));
    farm.client_arrives("a2");
    farm.say("a2", Farm::picture(1, 3));
    CHECK(farm.all<NeedChunk>("a2").size() == 1);
    farm.say("a", Goodbye{}); // the old connection does not matter any more
    farm.say("a2", Farm::scene_chunk());
    CHECK(farm.last<JobState>("a2").phase == JobPhase::queued);
}

TEST_CASE("a scene with another hash than announced fails the job") {
    Farm farm;
    farm.client_arrives("a");
    SubmitJob picture = Farm::picture(1, 3);
    picture.scene.bytes[0] ^= 1;
    farm.say("a", picture);
    Chunk chunk = Farm::scene_chunk();
    chunk.blob = picture.scene;
    farm.say("a", chunk);
    CHECK(farm.last<JobState>("a").phase == JobPhase::failed);
    CHECK(farm.last<JobState>("a").reason.find("hash") != std::string::npos);
}

TEST_CASE("jobs are found by id and prefix and name and number") {
    Farm farm;
    farm.submit(0x12, 1);
    farm.submit(0x13, 1);
    SubmitJob namesake = Farm::picture(0x14, 1);
    namesake.job.bytes[0] = 0xab;
    namesake.job_name = "picture18"; // as the first one's
    farm.submit("client", namesake);
    struct Row {
        std::string what;
        std::uint32_t number; // 0: refused
    };
    for (const Row& row : {Row{"#2", 2}, Row{"#9", 0}, Row{"#x", 0}, Row{"picture19", 2},
                           Row{"picture18", 3}, Row{"ab", 3}, Row{"00000000-0000", 0},
                           Row{to_string(id_of<JobId>(0x12)), 1}, Row{"nothing", 0}, Row{"", 3}}) {
        CAPTURE(row.what);
        farm.forget("client");
        farm.say("client", FindJob{row.what});
        if (row.number == 0)
            CHECK(farm.heard<Refused>("client"));
        else
            CHECK(farm.last<JobState>("client").number == row.number);
    }
}

TEST_CASE("a number alone is a job's, unless an id begins so") {
    Farm farm;
    farm.submit(1, 1);
    farm.submit(2, 1);
    SubmitJob other = Farm::picture(3, 1);
    other.job.bytes[0] = 0x23;
    farm.submit("client", other);
    farm.say("client", FindJob{"1"});
    CHECK(farm.last<JobState>("client").number == 1);
    farm.say("client", FindJob{"2"});
    CHECK(farm.last<Refused>("client").reason == "'2' fits 2 jobs: give more of the id, or '#2'");
    farm.say("client", FindJob{"23"});
    CHECK(farm.last<JobState>("client").number == 3);
    farm.forget("client");
    farm.say("client", FindJob{"4"});
    CHECK(farm.last<Refused>("client").code == RefusalCode::no_such_job);
}

TEST_CASE("cancelling stops the tiles in flight and leaves the other jobs alone") {
    Farm farm;
    farm.worker_arrives("w", 1, 2, 4);
    const JobId job = farm.submit(1, 10);
    const auto tiles = farm.tiles("w");
    farm.say("client", ControlJob{job, JobDeed::cancel, 0});
    CHECK(farm.last<JobState>("client").phase == JobPhase::cancelled);
    CHECK(farm.all<CancelTile>("w").size() == 4);
    const JobId next = farm.submit(2, 10);
    CHECK(farm.tiles("w").empty()); // the credit is used until the worker answers
    for (const auto& tile : tiles)
        farm.fail("w", tile, FailureCode::cancelled);
    CHECK(farm.tiles("w").size() == 4);
    CHECK(farm.state(next).phase == JobPhase::running);
    CHECK(farm.state(job).phase == JobPhase::cancelled);
    farm.say("client", ControlJob{id_of<JobId>(77), JobDeed::cancel, 0});
    CHECK(farm.last<Refused>("client").code == RefusalCode::no_such_job);
}

TEST_CASE("whoever has not said hello is told so") {
    Farm farm;
    farm.say("stranger", Beat{});
    CHECK(farm.last<Refused>("stranger").code == RefusalCode::unknown_peer);
    farm.say("stranger", Farm::picture(1, 1));
    CHECK(farm.dispatcher.job_count() == 0);
    farm.forget("stranger");
    farm.say("stranger", Goodbye{});
    CHECK_FALSE(farm.heard<Refused>("stranger"));
    farm.forget("stranger"); // a refusal is not refused: two brokers would do so for ever
    farm.say("stranger", Refused{RefusalCode::unknown_peer, {}, "say hello first"});
    CHECK_FALSE(farm.heard<Refused>("stranger"));
}

TEST_CASE("messages out of place are refused and counted") {
    Farm farm;
    farm.client_arrives("c");
    farm.say("c", TileRendered{id_of<JobId>(1), {}, {}, {}, {}, 0, {}, {Blob(Bytes(3))}});
    CHECK(farm.last<Refused>("c").code == RefusalCode::unexpected);
    farm.worker_arrives("w", 1, 1, 1);
    farm.say("w", Farm::picture(1, 1));
    CHECK(farm.last<Refused>("w").code == RefusalCode::unexpected);
    CHECK(farm.dispatcher.counters().unexpected == 2);
}

TEST_CASE("rubbish is refused and counted, and all of it is one kind of event") {
    Farm farm;
    for (int i = 0; i < 1000; ++i)
        farm.event(PeerSpokeRubbish{"x", {ErrorCode::malformed_frame, "noise"}});
    CHECK(farm.dispatcher.counters().rubbish == 1000);
    CHECK(std::ranges::all_of(farm.logs, [](const Log& line) {
        return line.kind == "rubbish" && line.subject.empty(); // so the log is not flooded
    }));
    CHECK(farm.last<Refused>("x").code == RefusalCode::malformed);
    farm.event(PeerSpokeRubbish{"y", {ErrorCode::version_mismatch, "version 9"}});
    CHECK(farm.last<Refused>("y").code == RefusalCode::version_mismatch);
    CHECK(farm.dispatcher.counters().wrong_version == 1);
}
