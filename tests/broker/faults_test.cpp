#include "tests/broker/farm.hpp"
#include "tests/support/messages.hpp"
#include "tests/support/seeds.hpp"

#include <deque>

using namespace fraja;
using namespace fraja::broker;
using namespace fraja::protocol;
using namespace std::chrono_literals;

TEST_CASE("a silent worker is lost after three heartbeats and soon then, whenever it spoke last") {
    for (const Duration phase : {0ms, 1ms, 130ms, 499ms, 730ms}) {
        CAPTURE(phase.count());
        Farm farm;
        farm.worker_arrives("alive", 1, 1, 2);
        farm.pass(phase);
        farm.worker_arrives("dead", 2, 1, 2);
        for (int i = 0; i < 6; ++i) {
            farm.beat("alive", 2, {});
            farm.pass(500ms);
        }
        CHECK(farm.dispatcher.worker_count() == 2);
        farm.pass(1000ms / 32 + 1ms);
        CHECK(farm.dispatcher.worker_count() == 1);
    }
}

TEST_CASE("the tiles of a silent worker go to the front of the queue") {
    Farm farm;
    farm.worker_arrives("dead", 1, 1, 2);
    farm.submit(1, 6);
    const auto lost = farm.tiles("dead");
    REQUIRE(lost.size() == 2);
    farm.worker_arrives("alive", 2, 1, 2);
    auto tiles = farm.tiles("alive");
    CHECK(tiles[0].rect.x == 20);
    for (int i = 0; i < 5; ++i) {
        farm.pass(700ms);
        farm.beat("alive", 2, tiles);
    }
    CHECK(farm.dispatcher.worker_count() == 1);
    CHECK(farm.dispatcher.counters().workers_lost == 1);
    farm.forget("alive");
    farm.render("alive", tiles[0]);
    farm.render("alive", tiles[1]);
    const auto next = farm.tiles("alive");
    REQUIRE(next.size() == 2);
    CHECK(next[0].rect == lost[0].rect);
    CHECK(next[1].rect == lost[1].rect);
    CHECK(next[0].attempt != lost[0].attempt);
}

TEST_CASE("a worker that beats is not lost and one that is unreachable is at once") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 1);
    const JobId job = farm.submit(1, 2);
    const auto tiles = farm.tiles("w");
    for (int i = 0; i < 20; ++i) {
        farm.pass(900ms);
        farm.beat("w", 1, tiles, static_cast<std::uint64_t>(i));
    }
    CHECK(farm.dispatcher.worker_count() == 1);
    farm.event(PeerUnreachable{"w"});
    CHECK(farm.dispatcher.worker_count() == 0);
    CHECK(farm.state(job).in_flight_count == 0);
}

TEST_CASE("a goodbye requeues without blame") {
    Farm farm;
    farm.limits.attempts_max = 1;
    const JobId job = farm.submit(1, 2);
    for (std::uint8_t i = 0; i < 10; ++i) {
        farm.worker_arrives("w", i, 2, 4);
        farm.say("w", Goodbye{});
    }
    CHECK(farm.state(job).phase == JobPhase::running);
    CHECK(farm.dispatcher.counters().workers_lost == 0);
}

TEST_CASE("limits that change while a broker runs hold from then on, those that peers know stay") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 1);
    const JobId job = farm.submit(1, 2);
    farm.fail("w", farm.tiles("w").at(0), protocol::FailureCode::machine);
    CHECK(farm.state(job).phase == JobPhase::running);
    Limits limits = farm.limits;
    limits.attempts_max = 2;
    limits.heartbeat = 1h;
    farm.dispatcher.change_limits(limits);
    farm.fail("w", farm.tiles("w").back(), protocol::FailureCode::machine);
    CHECK(farm.state(job).phase == JobPhase::failed);
    farm.worker_arrives("other", 2, 1, 1);
    CHECK(farm.last<Welcome>("other").heartbeat == farm.limits.heartbeat);
}

TEST_CASE("a worker that says hello again gets its tiles anew") {
    Farm farm;
    farm.worker_arrives("old connection", 1, 1, 2);
    farm.submit(1, 4);
    const auto before = farm.tiles("old connection");
    farm.worker_arrives("new connection", 1, 1, 2);
    CHECK(farm.dispatcher.worker_count() == 1);
    const auto after = farm.tiles("new connection");
    REQUIRE(after.size() == 2);
    CHECK(after[0].rect == before[0].rect);
    CHECK(after[0].attempt != before[0].attempt);
    farm.render("old connection", before[0]); // no session there any more
    CHECK(farm.last<Refused>("old connection").code == RefusalCode::unknown_peer);
}

TEST_CASE("a worker's hello that comes twice changes nothing") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 2);
    farm.submit(1, 4);
    const auto before = farm.tiles("w");
    REQUIRE(before.size() == 2);
    const std::size_t said = farm.sent["w"].size();
    farm.worker_arrives("w", 1, 1, 2);
    CHECK(farm.sent["w"].size() == said);
    farm.render("w", before[0]);
    farm.render("w", before[0]); // an answer that comes twice is stale
    CHECK(farm.dispatcher.counters().stale_answers == 1);
    CHECK(farm.tiles("w").size() == 1);
}

TEST_CASE("an older incarnation of a worker is refused") {
    Farm farm;
    WorkerHello hello{.worker = id_of<WorkerId>(1),
                      .incarnation = 5,
                      .worker_name = "w",
                      .threads = 1,
                      .credit = 1,
                      .speed_rays_per_s = 0,
                      .memory_bytes = 0,
                      .tags = {},
                      .program_version = {}};
    farm.say("new", hello);
    hello.incarnation = 4;
    farm.say("old", hello);
    CHECK(farm.last<Refused>("old").code == RefusalCode::conflict);
    CHECK(farm.dispatcher.worker_count() == 1);
}

TEST_CASE("a tile that fails goes to another worker and after three failures its job fails") {
    Farm farm;
    const JobId job = farm.submit(1, 1);
    const JobId other = farm.submit(2, 1);
    farm.worker_arrives("a", 1, 1, 2);
    const auto tile = farm.tiles("a").front();
    REQUIRE(tile.job == job);
    farm.worker_arrives("b", 2, 1, 1);
    farm.worker_arrives("c", 3, 1, 1);
    farm.fail("a", tile, FailureCode::machine);
    CHECK(farm.tiles("a").empty()); // not where it failed
    auto at_b = farm.tiles("b"), at_c = farm.tiles("c");
    REQUIRE(at_b.size() + at_c.size() == 1);
    const bool first_b = !at_b.empty();
    farm.fail(first_b ? "b" : "c", first_b ? at_b[0] : at_c[0], FailureCode::machine);
    const auto third = farm.tiles(first_b ? "c" : "b");
    REQUIRE(third.size() == 1);
    CHECK(farm.state(job).phase == JobPhase::running);
    farm.fail(first_b ? "c" : "b", third[0], FailureCode::machine);
    CHECK(farm.state(job).phase == JobPhase::failed);
    CHECK(farm.state(job).reason.find("failed 3 times") != std::string::npos);
    CHECK(farm.state(job).reason.find("no luck") != std::string::npos);
    CHECK(farm.state(other).phase == JobPhase::running);
}

TEST_CASE("the only worker is asked again although the tile failed there") {
    Farm farm;
    const JobId job = farm.submit(1, 1);
    farm.worker_arrives("a", 1, 1, 1);
    for (int i = 0; i < 3; ++i) {
        const auto tiles = farm.tiles("a");
        REQUIRE(tiles.size() == 1);
        farm.fail("a", tiles[0], FailureCode::machine);
    }
    CHECK(farm.state(job).phase == JobPhase::failed);
}

TEST_CASE("the only worker with a job's tags is asked again although the tile failed there") {
    Farm f;
    f.say("worker", WorkerHello{.worker = id_of<WorkerId>(1),
                                .incarnation = 1,
                                .worker_name = "worker",
                                .threads = 1,
                                .credit = 1,
                                .speed_rays_per_s = 0,
                                .memory_bytes = 0,
                                .tags = {"gpu"},
                                .program_version = "test"});
    f.worker_arrives("without", 2, 1, 1);
    SubmitJob job = Farm::picture(1, 1);
    job.wishes.tags = {"gpu"};
    f.submit("client", job);
    f.fail("worker", f.tiles("worker").at(0), FailureCode::machine);
    CHECK(f.tiles("worker").size() == 1);
    CHECK(f.tiles("without").empty());
}

TEST_CASE("a fault of the scene that one worker finds is asked of another one") {
    for (const bool is_true : {true, false}) {
        CAPTURE(is_true);
        Farm farm;
        farm.worker_arrives("a", 1, 1, 2);
        farm.worker_arrives("b", 2, 1, 1);
        const JobId job = farm.submit(1, 4);
        for (const RenderTile& tile : farm.tiles("a")) // one opinion, however often it is told
            farm.fail("a", tile, FailureCode::scene);
        CHECK_FALSE(is_over(farm.state(job).phase));
        for (auto tiles = farm.tiles("b"); !tiles.empty(); tiles = farm.tiles("b"))
            if (is_true)
                farm.fail("b", tiles.at(0), FailureCode::scene);
            else
                farm.render("b", tiles.at(0));
        if (!is_true)
            farm.render_all("a"); // what had not failed there
        CHECK(farm.state(job).phase == (is_true ? JobPhase::failed : JobPhase::done));
        CHECK(farm.state(job).reason == (is_true ? "no luck" : ""));
    }
}

TEST_CASE("a fault of the scene that the only worker finds fails the job at once") {
    Farm farm;
    const JobId job = farm.submit(1, 8);
    farm.worker_arrives("a", 1, 2, 4);
    const auto tiles = farm.tiles("a");
    farm.fail("a", tiles[1], FailureCode::scene);
    CHECK(farm.state(job).phase == JobPhase::failed);
    CHECK(farm.state(job).reason == "no luck");
    CHECK(farm.all<CancelTile>("a").size() == 3);
}

TEST_CASE("a tile that kills its workers fails its job") {
    Farm farm;
    const JobId job = farm.submit(1, 1);
    for (std::uint8_t i = 1; i <= 3; ++i) {
        const PeerId peer = "w" + std::to_string(i);
        farm.worker_arrives(peer, i, 1, 2);
        REQUIRE(farm.tiles(peer).size() == 1);
        farm.event(PeerUnreachable{peer});
    }
    CHECK(farm.state(job).phase == JobPhase::failed);
}

TEST_CASE("a worker that comes back was not killed by its tile") {
    Farm farm;
    const JobId job = farm.submit(1, 1);
    for (int i = 0; i < 5; ++i) {
        const PeerId peer = "connection" + std::to_string(i);
        farm.worker_arrives(peer, 1, 1, 1);
        REQUIRE(farm.tiles(peer).size() == 1);
        farm.event(PeerUnreachable{peer});
    }
    CHECK(farm.state(job).phase == JobPhase::running);
    for (std::uint8_t i = 2; i <= 3; ++i) { // these do not
        farm.worker_arrives("dies", i, 1, 1);
        farm.event(PeerUnreachable{"dies"});
    }
    CHECK(farm.state(job).phase == JobPhase::failed);
}

TEST_CASE("a tile for which its worker is lost again and again fails its job in the end") {
    Farm farm;
    const JobId job = farm.submit(1, 1);
    int lost = 0;
    for (; lost < 100 && !is_over(farm.state(job).phase); ++lost) {
        const PeerId peer = "connection" + std::to_string(lost);
        farm.worker_arrives(peer, 1, 1, 1);
        farm.event(PeerUnreachable{peer});
    }
    CHECK(lost > 10);
    CHECK(lost < 20);
}

TEST_CASE("a broker that stood still takes nobody for silent before it has listened") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 1);
    farm.client_arrives("client");
    farm.say("client", Farm::picture(1, 1)); // whose scene does not come
    farm.pass(2s);
    for (const Duration still : {4s, 40s, 4000s}) {
        CAPTURE(still.count());
        farm.now = farm.now + still;
        farm.event(Tick{});
        CHECK(farm.dispatcher.worker_count() == 1);
        CHECK(farm.dispatcher.client_count() == 1);
    }
    farm.pass(1100ms); // with the two before: that is more than three beats
    CHECK(farm.dispatcher.worker_count() == 0);
    CHECK(farm.dispatcher.client_count() == 0);
    CHECK(farm.state(id_of<JobId>(1)).phase == JobPhase::waiting_for_scene);
}

TEST_CASE("pixels of a wrong size are a failure of the worker") {
    Farm farm;
    const JobId job = farm.submit(1, 1);
    farm.worker_arrives("a", 1, 1, 1);
    const auto tile = farm.tiles("a").front();
    TileRendered answer = Farm::answer(tile);
    answer.blobs = {Blob(Bytes(7))};
    farm.say("a", answer);
    CHECK(farm.state(job).done_count == 0);
    CHECK(farm.tiles("a").size() == 1);
}

TEST_CASE("answers that nobody waits for are counted and dropped") {
    Farm farm;
    farm.worker_arrives("a", 1, 1, 2);
    const SubmitJob picture = Farm::picture(1, 3);
    farm.subscribe(picture.job);
    farm.submit("client", picture);
    const auto tiles = farm.tiles("a");
    farm.render("a", tiles[0]);
    farm.render("a", tiles[0]);
    RenderTile never = tiles[1];
    never.attempt = AttemptNumber{9};
    farm.render("a", never);
    never.job = id_of<JobId>(50);
    farm.render("a", never);
    CHECK(farm.dispatcher.counters().stale_answers == 3);
    CHECK(farm.published<TileDone>(job_topic(picture.job)).size() == 1);
}

TEST_CASE("a tile that traces no ray within the lease is given to another and its late answer "
          "still counts") {
    Farm farm;
    const JobId job = farm.submit(1, 1);
    farm.worker_arrives("stuck", 1, 1, 1);
    const auto tile = farm.tiles("stuck");
    farm.worker_arrives("fresh", 2, 1, 1);
    for (Duration t{}; t < 61s; t += 900ms) {
        farm.pass(900ms);
        farm.beat("stuck", 1, tile, 5);
        farm.beat("fresh", 1, farm.all<RenderTile>("fresh"));
    }
    CHECK(farm.all<CancelTile>("stuck").size() == 1);
    const auto again = farm.tiles("fresh");
    REQUIRE(again.size() == 1);
    farm.forget("fresh");
    farm.render("stuck", tile[0]);
    CHECK(farm.state(job).phase == JobPhase::done);
    CHECK(farm.all<CancelTile>("fresh").size() == 1); // not needed any more
}

TEST_CASE("a tile that is stuck beside others that move is given to another, and it alone") {
    Farm farm;
    const JobId job = farm.submit(1, 3);
    farm.worker_arrives("w", 1, 2, 3);
    const auto tiles = farm.tiles("w");
    REQUIRE(tiles.size() == 3);
    farm.render("w", tiles[0]); // and the third begins
    farm.worker_arrives("fresh", 2, 1, 1);
    std::uint64_t rays = 0;
    for (Duration t{}; t < 61s; t += 900ms) {
        farm.pass(900ms);
        farm.beat_with("w", 3,
                       {{job, tiles[1].tile, tiles[1].attempt, 0},
                        {job, tiles[2].tile, tiles[2].attempt, ++rays}});
        farm.beat("fresh", 1, farm.all<RenderTile>("fresh"));
    }
    const auto cancelled = farm.all<CancelTile>("w");
    REQUIRE(cancelled.size() == 1);
    CHECK(cancelled[0].tile == tiles[1].tile);
    CHECK(farm.tiles("fresh").at(0).rect == tiles[1].rect);
}

TEST_CASE("a worker that draws fewer tiles at once than it says is not stuck") {
    Farm farm(Limits{.attempts_max = 1});
    const JobId job = farm.submit(1, 20);
    farm.worker_arrives("branch", 1, 8, 16); // which has one thread
    std::deque<RenderTile> waiting;
    for (int seconds = 0; seconds < 450 && !is_over(farm.state(job).phase); ++seconds) {
        farm.pass(1s);
        if (seconds % 20 == 19) { // each takes so long
            farm.render("branch", waiting.front());
            waiting.pop_front();
        }
        for (const RenderTile& tile : farm.tiles("branch"))
            waiting.push_back(tile);
        std::vector<TileInFlight> in_flight;
        for (const RenderTile& tile : waiting)
            in_flight.push_back({tile.job, tile.tile, tile.attempt,
                                 in_flight.empty() ? std::uint64_t(1 + seconds % 20) : 0});
        farm.beat_with("branch", 16, in_flight);
    }
    CHECK(farm.state(job).phase == JobPhase::done);
    CHECK(farm.dispatcher.counters().tiles_requeued == 0);
}

TEST_CASE("tiles that wait behind one that is stuck are given to others without blame") {
    Farm farm(Limits{.attempts_max = 1});
    const JobId job = farm.submit(1, 3);
    const JobId other = farm.submit(2, 1);
    CHECK(farm.state(other).phase == JobPhase::queued);
    farm.worker_arrives("w", 1, 1, 4);
    const auto tiles = farm.tiles("w");
    REQUIRE(tiles.size() == 4);
    const auto first_of = tiles[0].job; // that job fails: it was at work on it
    for (Duration t{}; t < 61s; t += 900ms) {
        farm.pass(900ms);
        farm.beat("w", 4, tiles);
    }
    CHECK(farm.state(first_of).phase == JobPhase::failed);
    CHECK_FALSE(is_over(farm.state(first_of == job ? other : job).phase));
}

TEST_CASE("a tile that is stuck gains no time by others that are given to its worker") {
    Farm farm;
    farm.submit(1, 9);
    farm.worker_arrives("w", 1, 1, 1);
    auto tiles = farm.tiles("w");
    REQUIRE(tiles.size() == 1);
    std::vector<CancelTile> cancelled;
    for (int seconds = 0; seconds < 70; ++seconds) {
        farm.pass(1s);
        farm.beat("w", 1 + static_cast<std::uint32_t>(seconds / 15), tiles);
        for (const CancelTile& cancel : farm.all<CancelTile>("w"))
            cancelled.push_back(cancel);
        for (const RenderTile& more : farm.tiles("w"))
            tiles.push_back(more);
    }
    CHECK(tiles.size() == 5);
    REQUIRE(cancelled.size() == 1);
    CHECK(cancelled[0].tile == tiles[0].tile);
}

TEST_CASE("a worker that still fetches its scene is not stuck") {
    Farm farm;
    farm.submit(1, 1);
    farm.worker_arrives("slow line", 1, 1, 1);
    const auto tiles = farm.tiles("slow line");
    for (Duration t{}; t < 200s; t += 900ms) {
        farm.pass(900ms);
        farm.beat("slow line", 1, tiles);
        farm.say("slow line", NeedChunk{scene_hash, 0});
    }
    CHECK(farm.all<CancelTile>("slow line").empty());
}

TEST_CASE("a slow tile that makes progress keeps its lease") {
    Farm farm;
    farm.submit(1, 1);
    farm.worker_arrives("slow", 1, 1, 1);
    const auto tile = farm.tiles("slow");
    std::uint64_t rays = 1;
    for (Duration t{}; t < 300s; t += 900ms) {
        farm.pass(900ms);
        farm.beat("slow", 1, tile, rays++);
    }
    CHECK_FALSE(farm.heard<CancelTile>("slow"));
}

TEST_CASE("a client that is lost before its scene has come may come back with it") {
    Farm farm;
    const SubmitJob job = Farm::picture(1, 1);
    farm.client_arrives("c");
    farm.say("c", job);
    CHECK(farm.heard<NeedChunk>("c"));
    farm.event(PeerUnreachable{"c"});
    CHECK(farm.state(job.job).phase == JobPhase::waiting_for_scene);
    farm.client_arrives("again");
    farm.say("again", job);
    REQUIRE(farm.heard<NeedChunk>("again"));
    farm.say("again", Farm::scene_chunk());
    CHECK(farm.state(job.job).phase == JobPhase::queued);
    // One that does not come back is waited for as long as any scene is.
    SubmitJob other = Farm::picture(2, 1);
    other.scene.bytes[0] ^= 1;
    farm.say("again", other);
    farm.event(PeerUnreachable{"again"});
    farm.pass(farm.limits.scene_patience + 1s);
    CHECK(farm.state(other.job).phase == JobPhase::failed);
}

TEST_CASE("a tile that the worker has received and names no more is sent again") {
    Farm farm;
    farm.submit(1, 1);
    farm.worker_arrives("w", 1, 1, 1);
    REQUIRE(farm.tiles("w").size() == 1);
    farm.beat("w", 1, {});
    const auto again = farm.tiles("w");
    REQUIRE(again.size() == 1);
    CHECK(again[0].attempt == AttemptNumber{2});
}

TEST_CASE("a tile that is still on its way to the worker is not lost, however long that takes") {
    Farm farm;
    farm.submit(1, 2);
    farm.worker_arrives("w", 1, 1, 2);
    const auto tiles = farm.tiles("w");
    REQUIRE(tiles.size() == 2);
    for (int i = 0; i < 20; ++i) {
        farm.pass(900ms);
        farm.received["w"] = i < 10 ? 0 : 1;
        farm.beat("w", 2, i < 10 ? std::vector<RenderTile>{} : std::vector{tiles[0]});
    }
    CHECK(farm.tiles("w").empty());
    CHECK(farm.dispatcher.counters().tiles_requeued == 0);
}

TEST_CASE("a worker that cancels what nobody asked it to fails the tile in the end") {
    Farm farm;
    const JobId job = farm.submit(1, 1);
    farm.worker_arrives("w", 1, 1, 1);
    for (std::uint32_t i = 0; i < farm.limits.attempts_max; ++i) {
        const auto tiles = farm.tiles("w");
        REQUIRE(tiles.size() == 1);
        farm.fail("w", tiles[0], FailureCode::cancelled);
    }
    CHECK(farm.state(job).phase == JobPhase::failed);
}

TEST_CASE("absurd counts and times of a worker do not overflow") {
    Farm farm;
    const JobId job = farm.submit(1, 3);
    farm.worker_arrives("w", 1, 3, 3);
    farm.now = farm.now + 2s;
    for (const RenderTile& tile : farm.tiles("w")) {
        TileRendered answer = Farm::answer(tile);
        answer.rays = {UINT64_MAX, UINT64_MAX, 1, 0};
        answer.elapsed = Duration::max();
        farm.say("w", answer);
    }
    const JobState state = farm.state(job);
    CHECK(state.phase == JobPhase::done);
    CHECK(state.rays == Rays{UINT64_MAX, UINT64_MAX, 3, 0});
    CHECK(state.rays.total() == UINT64_MAX);
    CHECK(state.render_time == 6s); // no longer than the worker had them
}

TEST_CASE("nobody else can spoil the scene that a client sends") {
    Farm farm;
    farm.client_arrives("owner");
    farm.client_arrives("stranger");
    farm.say("owner", Farm::picture(1, 1));
    Chunk spoilt = Farm::scene_chunk();
    spoilt.blobs = {Blob(Bytes(scene_bytes.size()))};
    farm.say("stranger", spoilt);
    CHECK(farm.dispatcher.counters().unexpected == 1);
    farm.say("owner", Farm::scene_chunk());
    CHECK(farm.state(id_of<JobId>(1)).phase == JobPhase::queued);
}

TEST_CASE("a worker that drains gets nothing new and leaves nothing behind") {
    Farm farm;
    const JobId job = farm.submit(1, 6);
    farm.worker_arrives("w", 1, 1, 2);
    const auto tiles = farm.tiles("w");
    farm.beat("w", 0, tiles);
    farm.render("w", tiles[0]);
    farm.fail("w", tiles[1], FailureCode::cancelled); // handed back
    CHECK(farm.tiles("w").empty());
    farm.say("w", Goodbye{});
    CHECK(farm.state(job).done_count == 1);
    CHECK(farm.state(job).in_flight_count == 0);
    farm.worker_arrives("next", 2, 1, 9);
    CHECK(farm.tiles("next").size() == 5);
}

TEST_CASE("whatever workers do no credit is overrun and every job ends right") {
    for_each_seed(300, [](Rng& rng) {
        Limits limits;
        limits.attempts_max = 1000; // so that only the end decides
        Farm farm(limits);
        struct Member {
            std::uint32_t credit = 0;
            std::vector<RenderTile> has;
            bool here = false;
        };
        std::map<PeerId, Member> workers;
        std::vector<SubmitJob> pictures;
        for (std::uint8_t i = 1; i <= 3; ++i) {
            pictures.push_back(Farm::picture(i, 1 + static_cast<std::uint32_t>(rng.below(30))));
            farm.subscribe(pictures.back().job);
        }
        const auto collect = [&] {
            for (auto& [peer, member] : workers) {
                for (const auto& tile : farm.tiles(peer))
                    if (member.here)
                        member.has.push_back(tile);
                CHECK(member.has.size() <= member.credit);
            }
        };
        std::size_t submitted = 0;
        for (int turn = 0; turn < 400; ++turn) {
            if (submitted < pictures.size() && rng.below(20) == 0)
                farm.submit("client", pictures[submitted++]);
            const auto n = static_cast<std::uint8_t>(rng.below(4));
            const PeerId peer = "w" + std::to_string(n);
            Member& member = workers[peer];
            if (!member.here) {
                member = {1 + static_cast<std::uint32_t>(rng.below(5)), {}, true};
                farm.worker_arrives(peer, n, 1, member.credit);
            } else if (rng.below(30) == 0) {
                farm.event(PeerUnreachable{peer});
                member.here = false;
                member.has.clear();
            } else if (!member.has.empty()) {
                const std::size_t at = rng.below(member.has.size());
                const RenderTile tile = member.has[at];
                member.has.erase(member.has.begin() + static_cast<std::ptrdiff_t>(at));
                if (rng.below(10) == 0)
                    farm.fail(peer, tile, FailureCode::machine);
                else
                    farm.render(peer, tile);
            } else {
                Message rubbish =
                    random_message(rng); // well-formed, but for those that set the credit
                while (std::holds_alternative<WorkerHello>(rubbish) ||
                       std::holds_alternative<WorkerBeat>(rubbish) ||
                       std::holds_alternative<BrokerHello>(rubbish)) // and then it stands for ours
                    rubbish = random_message(rng);
                farm.say(peer, rubbish);
                if (farm.dispatcher.worker_count() < workers.size()) {
                    farm.event(PeerUnreachable{peer}); // a goodbye, or a hello as a client
                    member.here = false;
                }
            }
            collect();
            farm.pass(10ms);
            collect();
            for (auto& [id, other] : workers) {
                if (other.here)
                    farm.beat(id, other.credit, other.has, static_cast<std::uint64_t>(turn));
                collect(); // what one says may bring another a tile
            }
        }
        while (submitted < pictures.size())
            farm.submit("client", pictures[submitted++]);
        // The trouble is over: one good worker finishes everything.
        for (auto& [peer, member] : workers)
            farm.event(PeerUnreachable{peer});
        farm.worker_arrives("good", 9, 1, 3);
        for (auto tiles = farm.tiles("good"); !tiles.empty(); tiles = farm.tiles("good"))
            for (const auto& tile : tiles)
                farm.render("good", tile);
        for (const SubmitJob& picture : pictures) {
            CHECK(farm.state(picture.job).phase == JobPhase::done);
            std::set<TileIndex> seen;
            for (const auto& tile : farm.published<TileDone>(job_topic(picture.job)))
                CHECK(seen.insert(tile.tile).second);
            CHECK(seen.size() == farm.state(picture.job).cell_count);
        }
    });
}

TEST_CASE("a worker that tells a lone broker of a later term is not given more than it takes") {
    Farm farm;
    farm.worker_arrives("a", 1, 1, 3);
    const JobId job = farm.submit(1, 20);
    const auto first = farm.tiles("a");
    REQUIRE(first.size() == 3);
    WorkerBeat beat{.credit = 3, .in_flight = {}, .tiles_received = farm.received["a"]};
    for (const RenderTile& tile : first)
        beat.in_flight.push_back({tile.job, tile.tile, tile.attempt, 1});
    beat.term = {1'000, id_of<BrokerId>(200)};
    for (int i = 0; i < 20; ++i) {
        farm.say("a", beat);
        farm.pass(farm.limits.heartbeat / 2);
    }
    CHECK(farm.tiles("a").empty());
    for (auto given = first; !given.empty(); given = farm.tiles("a"))
        for (const RenderTile& tile : given)
            farm.render("a", tile);
    CHECK(farm.state(job).phase == JobPhase::done);
}
