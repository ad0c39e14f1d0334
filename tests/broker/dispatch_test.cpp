// Who gets which tile: sizes, probes, wishes, shares, and help for those who are late.
#include "tests/broker/machines.hpp"

#include "common/protocol/limits.hpp"
#include "common/protocol/reasons.hpp"
#include "common/protocol/settings.hpp"

namespace fraja::broker {
namespace {

using namespace protocol;
using namespace std::chrono_literals;

TEST_CASE("an automatic job is probed once, by a few rays, and a fixed one is not") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 2);
    farm.submit("client", automatic(1, 256, 192));
    const auto tiles = farm.tiles("w");
    REQUIRE(tiles.size() == 2);
    CHECK(tiles[0].probe_side == 32);
    CHECK(tiles[0].rect == PixelRect{0, 0, 256, 192});
    CHECK(tiles[1].probe_side == 0);
    farm.submit("client", Farm::picture(2, 3));
    farm.submit("client", automatic(3, 16, 16)); // a probe would tell too little
    farm.say("w", probed(tiles[0], [](PixelRect) { return 1.0f; }));
    farm.render("w", tiles[1]);
    for (const auto& tile : farm.tiles("w"))
        CHECK(tile.probe_side == 0);
}

TEST_CASE("a probe has probe_squares_max squares at most, which a worker takes") {
    CHECK(Limits{}.probe_squares_max <= protocol::probe_squares_max);
    const auto squares = [](std::uint64_t squares_max, std::uint32_t side) {
        Limits limits;
        limits.probe_squares_max = squares_max;
        Farm farm(limits);
        farm.worker_arrives("w", 1, 1, 2);
        farm.submit("client", automatic(1, side, side));
        const RenderTile probe = farm.tiles("w").at(0);
        REQUIRE(probe.probe_side > 0);
        return probe_squares(probe.rect, probe.probe_side);
    };
    CHECK(squares(16, 256) <= 16);
    CHECK(squares(Limits{}.probe_squares_max, 256) > 16);
    CHECK(squares(Limits{}.probe_squares_max, 4096) <= Limits{}.probe_squares_max);
    CHECK(squares(1 << 20, 4096) > Limits{}.probe_squares_max);
}

namespace {

/// Tiles, but for the probe, of a picture of 512 x 512 pixels at 100,000 rays a second.
std::size_t tiles_drawn(const Limits& limits) {
    Farm farm(limits);
    farm.worker_arrives("w", 1, 1, 1);
    const JobId job = farm.submit("client", automatic(1, 512, 512));
    std::size_t count = 0;
    for (auto tiles = farm.tiles("w"); !tiles.empty(); tiles = farm.tiles("w")) {
        REQUIRE(tiles.size() == 1);
        if (tiles[0].probe_side > 0) {
            farm.say("w", probed(tiles[0], [](PixelRect) { return 1.0f; }));
            continue;
        }
        ++count;
        TileRendered answer = Farm::answer(tiles[0]);
        answer.elapsed = std::chrono::microseconds(10 * tiles[0].rect.pixel_count());
        farm.now = farm.now + answer.elapsed;
        farm.say("w", answer);
    }
    CHECK(farm.state(job).phase == JobPhase::done);
    return count;
}

} // namespace

TEST_CASE("tiles take tile_time_min at least, tile_time_max at most, a second has so many") {
    constexpr std::size_t blocks = 64; // of 64 x 64 pixels: larger no tile is that is not joined
    constexpr Duration never = 0s;
    CHECK(tiles_drawn({.joined_time_max = never}) > blocks); // the last ones are small
    CHECK(tiles_drawn({.tile_time_min = 1s, .joined_time_max = never}) == blocks);
    CHECK(tiles_drawn({.tiles_per_s_max = 1, .joined_time_max = never}) == blocks);
    CHECK(tiles_drawn({.tile_time_max = 10ms}) > 3 * blocks);
}

TEST_CASE("blocks are joined as long as a tile takes no more than joined_time_max") {
    constexpr std::size_t blocks = 64; // each takes 41 ms
    const std::size_t some = tiles_drawn({.tile_time_min = 1s, .joined_time_max = 200ms});
    CHECK(some < blocks / 2);
    CHECK(some >= blocks / 4);
    CHECK(tiles_drawn({.tile_time_min = 1s, .joined_time_max = 10s}) < some);
}

TEST_CASE("a worker of absurdly many threads does no harm") {
    Farm farm;
    farm.worker_arrives("w", 1, UINT32_MAX, 4);
    const JobId job = farm.submit("client", automatic(1, 512, 512));
    std::vector<RenderTile> open = farm.tiles("w");
    for (std::size_t i = 0; i < open.size(); ++i) {
        const RenderTile tile = open[i];
        farm.now = farm.now + 5ms;
        if (tile.probe_side > 0)
            farm.say("w", probed(tile, [](PixelRect) { return 1.0f; }));
        else
            farm.render("w", tile);
        for (const RenderTile& next : farm.tiles("w"))
            open.push_back(next);
    }
    CHECK(farm.state(job).phase == JobPhase::done);
}

TEST_CASE("a late tile is given out again in overbooked_parts_max parts at most") {
    const auto parts_most = [](Limits limits) {
        limits.heartbeat = 1h; // nobody need beat
        Farm farm(limits);
        farm.worker_arrives("slow", 1, 1, 1'000); // so nothing is left to be given
        farm.submit("client", automatic(1, 512, 512));
        std::vector<RenderTile> late;
        const auto look = [&] {
            for (const RenderTile& tile : farm.tiles("slow"))
                late.push_back(tile);
        };
        look();
        REQUIRE(late.at(0).probe_side > 0);
        farm.say("slow", probed(late[0], [](PixelRect) { return 1.0f; }));
        look();
        TileRendered first = Farm::answer(late.at(1)); // and how slow it is, is known
        first.elapsed = 10s;
        farm.now = farm.now + 10s;
        farm.say("slow", first);
        look();
        late.erase(late.begin(), late.begin() + 2);
        farm.worker_arrives("fast", 2, 64, 64);
        for (int i = 0; i < 100; ++i) {
            farm.event(Tick{});
            const auto parts = farm.tiles("fast");
            farm.now = farm.now + 50ms; // it has had them for longer than it says
            for (const RenderTile& part : parts)
                farm.render("fast", part);
        }
        CHECK(farm.dispatcher.counters().tiles_overbooked > 0);
        const std::string words = "given out once more in ";
        std::uint64_t most = 0;
        for (const Log& log : farm.logs)
            if (const auto at = log.text.find(words); at != std::string::npos)
                most =
                    std::max<std::uint64_t>(most, std::stoull(log.text.substr(at + words.size())));
        return most;
    };
    CHECK(parts_most({}) > 3);
    CHECK(parts_most({}) <= 16);
    CHECK(parts_most({.overbooked_parts_max = 3}) == 3);
}

TEST_CASE("whether somebody could help out is looked at every overbook_interval") {
    for (const Duration interval : {7ms, 50ms}) {
        Farm farm(Limits{.overbook_interval = interval, .heartbeat = 1h});
        farm.worker_arrives("at work", 1, 1, 2, {"able"});
        SubmitJob s = Farm::picture(1, 3);
        s.wishes.tags = {"able"};
        farm.submit("client", s);
        farm.now = farm.now + 5ms;
        farm.render("at work", farm.tiles("at work").at(0));
        farm.event(Tick{});
        CHECK(farm.dispatcher.next_deadline() > farm.now + 1min); // nobody is idle
        farm.worker_arrives("idle", 2, 1, 1);
        farm.pass(1s);
        farm.event(Tick{});
        CHECK(farm.dispatcher.next_deadline() <= farm.now + interval);
        CHECK(farm.dispatcher.next_deadline() > farm.now);
        const Instant next = farm.dispatcher.next_deadline();
        farm.now = next;
        farm.event(Tick{});
        CHECK(farm.dispatcher.next_deadline() == next + interval);
    }
}

TEST_CASE("where a probe finds much is where the next tile is") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 2);
    farm.submit("client", automatic(1, 640, 480));
    const auto tiles = farm.tiles("w");
    REQUIRE(tiles.at(0).probe_side > 0);
    farm.say("w", probed(tiles[0], [](PixelRect r) {
                 return r.x >= 320 && r.x < 384 && r.y >= 192 && r.y < 256 ? 50.0f : 1.0f;
             }));
    const auto next = farm.tiles("w");
    REQUIRE(next.size() == 1);
    CHECK(next[0].rect.x >= 320);
    CHECK(next[0].rect.x < 384);
    CHECK(next[0].rect.y >= 192);
    CHECK(next[0].rect.y < 256);
}

TEST_CASE("a probe that fails, or tells rubbish, does no harm") {
    for (const int how : {0, 1, 2, 3}) {
        CAPTURE(how);
        Farm farm;
        farm.worker_arrives("w", 1, 1, 2);
        const JobId job = farm.submit("client", automatic(1, 64, 48));
        auto open = farm.tiles("w");
        REQUIRE(open.at(0).probe_side > 0);
        if (how == 0)
            farm.fail("w", open[0], FailureCode::machine);
        else if (how == 1)
            farm.say("w", probed(open[0], [](PixelRect) { return -1.0f / 0.0f; }));
        else if (how == 2)
            farm.render("w", open[0]); // pixels
        else
            farm.event(PeerUnreachable{"w"});
        if (how == 3) {
            farm.worker_arrives("w", 1, 1, 2);
            open.clear();
        } else {
            open.erase(open.begin());
        }
        for (int i = 0; i < 1'000 && farm.state(job).phase != JobPhase::done; ++i) {
            for (const auto& more : farm.tiles("w"))
                open.push_back(more);
            REQUIRE_FALSE(open.empty());
            CHECK(open.front().probe_side == 0); // it goes without
            farm.render("w", open.front());
            open.erase(open.begin());
        }
        CHECK(farm.state(job).phase == JobPhase::done);
    }
}

TEST_CASE("a job that is tried again does not wait for the probe that came when it was over") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 2);
    SubmitJob s = automatic(1, 256, 192);
    s.wishes.schedule = Schedule::weighted; // which waits for the probe
    const JobId job = farm.submit("client", s);
    const RenderTile probe = farm.tiles("w").at(0);
    REQUIRE(probe.probe_side > 0);
    farm.say("client", ControlJob{job, JobDeed::cancel, 0});
    farm.say("w", probed(probe, [](PixelRect) { return 1.0f; }));
    farm.say("client", ControlJob{job, JobDeed::retry, 0});
    const auto again = farm.tiles("w");
    REQUIRE_FALSE(again.empty());
    farm.say("w", probed(again[0], [](PixelRect) { return 1.0f; }));
    const auto tiles = farm.tiles("w");
    REQUIRE_FALSE(tiles.empty());
    CHECK(tiles[0].probe_side == 0);
}

TEST_CASE("tags are fitted: K by any value, K=V by that one") {
    struct Row {
        std::vector<std::string> wanted, tags;
        bool fits;
    };
    for (const Row& row :
         {Row{{}, {}, true}, Row{{"gpu"}, {}, false}, Row{{"gpu"}, {"gpu"}, true},
          Row{{"gpu"}, {"gpu=8"}, true}, Row{{"gpu"}, {"gpus"}, false},
          Row{{"gpu=8"}, {"gpu"}, false}, Row{{"gpu=8"}, {"gpu=8"}, true},
          Row{{"a", "b=1"}, {"b=1", "a=2", "c"}, true}, Row{{"a", "b=1"}, {"a"}, false}}) {
        CAPTURE(row.wanted);
        Farm farm;
        farm.worker_arrives("w", 1, 1, 1, row.tags);
        SubmitJob s = Farm::picture(1, 2);
        s.wishes.tags = row.wanted;
        farm.submit("client", s);
        CHECK(farm.tiles("w").size() == (row.fits ? 1 : 0));
    }
}

TEST_CASE("a job that suits nobody holds up no other, and goes on when somebody comes") {
    Farm farm;
    farm.worker_arrives("plain", 1, 1, 1);
    SubmitJob s = Farm::picture(1, 2);
    s.wishes.tags = {"gpu"};
    s.priority = 9;
    const JobId job = farm.submit("client", s);
    farm.submit("client", Farm::picture(2, 1));
    REQUIRE(farm.tiles("plain").size() == 1);
    CHECK(farm.state(job).reason == "waiting: no worker that is connected has the tag gpu "
                                    "(fraja-worker --tag gpu starts one)");
    farm.worker_arrives("fast", 2, 1, 1, {"gpu=2"});
    REQUIRE(farm.tiles("fast").size() == 1);
    CHECK(farm.state(job).reason.empty());
}

TEST_CASE("a job says that it gives way to others, or that nobody may be given tiles") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 1);
    SubmitJob s = Farm::picture(1, 3);
    s.priority = 5;
    farm.submit("client", s);
    const JobId job = farm.submit(2, 1);
    CHECK(farm.state(job).reason.starts_with("waiting: jobs of a higher priority go first ("));
    CHECK(farm.state(s.job).reason.empty());
    for (int i = 0; i < 3; ++i)
        farm.render("w", farm.tiles("w").at(0));
    CHECK(farm.state(job).reason.empty());
    farm.say("client", ControlWorker{"w", WorkerDeed::drain});
    farm.fail("w", farm.tiles("w").at(0), FailureCode::cancelled);
    CHECK(farm.state(job).reason.starts_with(std::string(no_worker_reasons) +
                                             "that is connected may be given tiles: "));
    farm.say("client", ControlWorker{"w", WorkerDeed::undrain});
    CHECK(farm.state(job).reason.empty());
}

TEST_CASE("no more workers than were asked for have tiles of a job") {
    Farm farm;
    for (std::uint8_t i = 1; i <= 5; ++i)
        farm.worker_arrives("w" + std::to_string(i), i, 1, 2);
    SubmitJob s = Farm::picture(1, 20);
    s.wishes.workers_max = 2;
    const JobId job = farm.submit("client", s);
    CHECK(farm.state(job).worker_count == 2);
    CHECK(farm.state(job).in_flight_count == 4);
    farm.event(PeerUnreachable{"w1"});
    farm.event(PeerUnreachable{"w2"});
    farm.event(PeerUnreachable{"w3"});
    CHECK(farm.state(job).worker_count == 2);
}

TEST_CASE("of very many idle workers some are compared, which costs the broker no time") {
    for (const std::uint32_t count : {200u, 300u}) {
        Farm farm;
        for (std::uint32_t i = 0; i < count; ++i) // the last one has the most threads
            farm.say("w" + std::to_string(1000 + i), WorkerHello{.worker = random_id<WorkerId>(),
                                                                 .incarnation = 1,
                                                                 .worker_name = "w",
                                                                 .threads = 1 + i / (count - 1),
                                                                 .credit = 2,
                                                                 .speed_rays_per_s = 0,
                                                                 .memory_bytes = 0,
                                                                 .tags = {},
                                                                 .program_version = "test"});
        SubmitJob s = Farm::picture(1, 20);
        s.wishes.workers_max = 1;
        farm.submit("client", s);
        CHECK(farm.tiles("w" + std::to_string(999 + count)).empty() == (count > 256));
    }
}

TEST_CASE("a picture of fixed tiles is probed where it is dealt out by what its parts cost") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 1);
    SubmitJob s = Farm::picture(1, 40);
    s.settings.aa = 4;
    s.wishes.schedule = Schedule::weighted;
    farm.submit("client", s);
    CHECK(farm.tiles("w").at(0).probe_side > 0);
}

TEST_CASE("what others can do is known again when somebody who boasted has left") {
    const auto first_tile = [](bool after_boaster) {
        Farm farm;
        farm.worker_arrives("w", 1, 1, 1);
        if (after_boaster) {
            farm.say("boaster", WorkerHello{.worker = id_of<WorkerId>(2),
                                            .incarnation = 1,
                                            .worker_name = "boaster",
                                            .threads = UINT32_MAX,
                                            .credit = 1,
                                            .speed_rays_per_s = 1e15,
                                            .memory_bytes = 0,
                                            .tags = {},
                                            .program_version = {}});
            farm.say("boaster", Goodbye{});
        }
        farm.pass(1s);
        farm.submit("client", automatic(1, 512, 512));
        const auto probe = farm.tiles("w").at(0);
        for (const char* peer : {"a", "b", "c"})
            farm.worker_arrives(peer, static_cast<std::uint8_t>(peer[0]), 1, 1);
        farm.say("w", probed(probe, [](PixelRect) { return 1.0f; }));
        return farm.tiles("w").at(0).rect;
    };
    CHECK(first_tile(true) == first_tile(false));
}

TEST_CASE("the share of a worker that is lost goes to the others") {
    Farm farm;
    farm.worker_arrives("a", 1, 1, 1);
    farm.worker_arrives("b", 2, 1, 1);
    SubmitJob s = Farm::picture(1, 8);
    s.wishes.schedule = Schedule::equal;
    const JobId job = farm.submit("client", s);
    REQUIRE(farm.tiles("b").size() == 1);
    farm.event(PeerUnreachable{"b"});
    farm.render_all("a");
    CHECK(farm.state(job).phase == JobPhase::done);
}

TEST_CASE("whoever was too late is told so, and its answer is counted as unneeded") {
    Farm farm;
    farm.worker_arrives("slow", 1, 1, 1);
    const JobId job = farm.submit("client", Farm::picture(1, 2));
    const RenderTile held = farm.tiles("slow").at(0);
    farm.worker_arrives("fast", 2, 1, 1);
    farm.now = farm.now + 10ms;
    farm.render("fast", farm.tiles("fast").at(0));
    farm.pass(200ms); // then it helps out
    const auto help = farm.tiles("fast");
    REQUIRE(help.size() == 1);
    CHECK(help[0].rect == held.rect);
    CHECK(help[0].attempt != held.attempt);
    farm.render("fast", help[0]);
    CHECK(farm.state(job).phase == JobPhase::done);
    REQUIRE(farm.all<CancelTile>("slow").size() == 1);
    CHECK(farm.last<CancelTile>("slow").attempt == held.attempt);
    const auto stale = farm.dispatcher.counters().stale_answers;
    farm.render("slow", held);
    CHECK(farm.dispatcher.counters().stale_answers == stale + 1);
    CHECK(farm.state(job).rays.camera == 200);
}

} // namespace
} // namespace fraja::broker
