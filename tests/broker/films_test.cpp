// Films: whose frames are drawn by whom, and how they share the farm with others.
#include "tests/broker/farm.hpp"

#include "common/protocol/settings.hpp"

#include <map>
#include <set>

namespace fraja::broker {
namespace {

using namespace protocol;
using namespace std::chrono_literals;

/// A frame of `columns` x 1 tiles of 10 x 10 pixels: its id is its number.
SubmitJob frame(std::uint8_t number, std::uint32_t columns, std::uint8_t film = 1) {
    SubmitJob s = Farm::picture(number, columns);
    s.wishes.film = id_of<FilmId>(film);
    s.wishes.frame = number;
    return s;
}

/// One that is cut as is good then.
SubmitJob large_frame(std::uint8_t number, std::uint32_t side) {
    SubmitJob s = frame(number, 1);
    s.settings.size = {side, side};
    s.settings.crop = {0, 0, side, side};
    s.tile_side = 0;
    return s;
}

std::string worker(unsigned i) {
    return "w" + std::to_string(i);
}

void workers_arrive(Farm& farm, unsigned count, std::uint32_t credit = 1) {
    for (unsigned i = 1; i <= count; ++i)
        farm.worker_arrives(worker(i), static_cast<std::uint8_t>(i), 1, credit);
}

std::multiset<std::uint32_t> frames_of(Farm& farm, unsigned workers) {
    std::multiset<std::uint32_t> frames;
    for (unsigned i = 1; i <= workers; ++i)
        for (const RenderTile& tile : farm.tiles(worker(i)))
            frames.insert(tile.frame);
    return frames;
}

TEST_CASE("tiles tell the frame that they are of, and so does the job") {
    Farm farm;
    workers_arrive(farm, 1);
    farm.subscribe(id_of<JobId>(3));
    const JobId job = farm.submit("client", frame(3, 1));
    const RenderTile tile = farm.tiles("w1").at(0);
    CHECK(tile.frame == 3);
    CHECK(farm.state(job).film == id_of<FilmId>(1));
    CHECK(farm.state(job).frame == 3);
    farm.render("w1", tile);
    REQUIRE(farm.published<TileDone>(job_topic(job)).size() == 1);
    CHECK(farm.published<TileDone>(job_topic(job))[0].frame == 3);
    farm.submit(4, 1);
    CHECK(farm.tiles("w1").at(0).frame == 0);
    CHECK(farm.state(id_of<JobId>(4)).film == FilmId{});
}

TEST_CASE("a frame that makes no sense is refused, and why") {
    struct Row {
        void (*spoil)(SubmitJob&);
        const char* why;
    };
    for (const Row& row : {
             Row{[](SubmitJob& s) { s.wishes.frame = 0; }, "a film's frames count from 1"},
             Row{[](SubmitJob& s) { s.wishes.film = {}; },
                 "a picture that is of no film has no number in one"},
             Row{[](SubmitJob& s) { s.wishes.schedule = Schedule::equal; },
                 "a film's frames are dealt out on demand"},
             Row{[](SubmitJob& s) { s.settings.time_limit = 1s; },
                 "a film's frames have no time limit"},
             Row{[](SubmitJob& s) { s.wishes.workers_max = 2; },
                 "the film's other frames have other wishes"},
             Row{[](SubmitJob& s) { s.wishes.tags = {"gpu"}; },
                 "the film's other frames have other wishes"},
         }) {
        CAPTURE(row.why);
        Farm farm;
        farm.submit("client", frame(1, 1));
        SubmitJob s = frame(2, 1);
        row.spoil(s);
        farm.say("client", s);
        CHECK(farm.last<Refused>("client").code == RefusalCode::invalid);
        CHECK(farm.last<Refused>("client").reason == row.why);
        farm.say("client", frame(2, 1)); // it has done no harm
        CHECK(farm.all<JobState>("client").size() == 1);
    }
}

TEST_CASE("each frame is one worker's, from the lowest number on, whatever came first") {
    Farm farm;
    JobId last;
    for (const int n : {5, 2, 4, 1, 3})
        last = farm.submit("client", frame(static_cast<std::uint8_t>(n), 4));
    workers_arrive(farm, 3, 2); // two tiles at a time
    CHECK(frames_of(farm, 3) == std::multiset<std::uint32_t>{1, 1, 2, 2, 3, 3});
    CHECK(farm.state(last).worker_count == 1);
    CHECK(farm.state(last).film_worker_count == 3);
}

TEST_CASE("a worker goes on with its frame, and then with the lowest that is nobody's") {
    Farm farm;
    for (std::uint8_t n = 1; n <= 4; ++n)
        farm.submit("client", frame(n, 3));
    workers_arrive(farm, 2);
    std::map<std::string, std::vector<std::uint32_t>> seen;
    for (int i = 0; i < 6; ++i)
        for (const char* name : {"w2", "w1"}) {
            const RenderTile tile = farm.tiles(name).at(0);
            seen[name].push_back(tile.frame);
            farm.render(name, tile);
        }
    CHECK(seen["w1"] == std::vector<std::uint32_t>{1, 1, 1, 4, 4, 4});
    CHECK(seen["w2"] == std::vector<std::uint32_t>{2, 2, 2, 3, 3, 3});
}

TEST_CASE("a worker that had another job's tile comes back to its frame") {
    Farm farm;
    for (std::uint8_t n = 1; n <= 3; ++n)
        farm.submit("client", frame(n, 3));
    workers_arrive(farm, 2);
    const RenderTile second = farm.tiles("w2").at(0);
    REQUIRE(second.frame == 2);
    SubmitJob urgent = Farm::picture(9, 1);
    urgent.priority = 1;
    farm.submit("client", urgent);
    farm.render("w2", second);
    const RenderTile other = farm.tiles("w2").at(0);
    REQUIRE(other.job == urgent.job);
    farm.render("w2", other); // now nobody works on 2
    CHECK(farm.tiles("w2").at(0).frame == 2);
}

TEST_CASE("who is left over helps where most is left for each worker") {
    Farm farm;
    farm.submit("client", frame(1, 4));
    farm.submit("client", frame(2, 20));
    farm.submit("client", frame(3, 10));
    workers_arrive(farm, 6);
    // 1, 2 and 3 have somebody. Then 2 has 19 left, 3 has 9; of 2 that is 18 for two, as much as
    // 3's for one, of which the lower number goes first, and then it is less.
    CHECK(farm.tiles("w4").at(0).frame == 2);
    CHECK(farm.tiles("w5").at(0).frame == 2);
    CHECK(farm.tiles("w6").at(0).frame == 3);
}

TEST_CASE("the frame of a worker that is lost is another's at once") {
    Farm farm;
    for (std::uint8_t n = 1; n <= 3; ++n)
        farm.submit("client", frame(n, 3));
    workers_arrive(farm, 2);
    REQUIRE(farm.tiles("w1").at(0).frame == 1);
    farm.event(PeerUnreachable{"w1"});
    farm.worker_arrives("w3", 3, 1, 1);
    CHECK(farm.tiles("w3").at(0).frame == 1);
}

TEST_CASE("a film has the share of one job, however many frames it has") {
    Farm farm;
    for (std::uint8_t n = 1; n <= 10; ++n)
        farm.submit("client", frame(n, 4));
    farm.submit(20, 40);
    for (std::uint8_t n = 31; n <= 33; ++n)
        farm.submit("client", frame(n, 4, 2));
    workers_arrive(farm, 9);
    std::map<int, int> tiles; // by party
    for (unsigned i = 1; i <= 9; ++i)
        for (const RenderTile& tile : farm.tiles(worker(i)))
            ++tiles[tile.job.bytes[15] / 10 % 10 + (tile.job.bytes[15] == 10 ? -1 : 0)];
    CHECK(tiles == std::map<int, int>{{0, 3}, {2, 3}, {3, 3}});
}

TEST_CASE("a frame that is more urgent than its film goes first, and counts in its film's share") {
    Farm farm;
    for (std::uint8_t n = 1; n <= 3; ++n)
        farm.submit("client", frame(n, 4));
    farm.submit(20, 4);
    farm.say("client", ControlJob{id_of<JobId>(3), JobDeed::set_priority, 5});
    workers_arrive(farm, 4);
    CHECK(frames_of(farm, 4) == std::multiset<std::uint32_t>{3, 3, 3, 3});
    workers_arrive(farm, 0);
    farm.worker_arrives("w5", 5, 1, 1); // the film has four tiles in flight
    CHECK(farm.tiles("w5").at(0).frame == 0);
}

TEST_CASE("--max-workers of a film counts all its frames' workers") {
    Farm farm;
    for (std::uint8_t n = 1; n <= 4; ++n) {
        SubmitJob s = frame(n, 3);
        s.wishes.workers_max = 2;
        farm.submit("client", s);
    }
    workers_arrive(farm, 4);
    CHECK(farm.tiles("w1").at(0).frame == 1);
    CHECK(farm.tiles("w2").at(0).frame == 2);
    CHECK(farm.tiles("w3").empty());
    CHECK(farm.tiles("w4").empty());
    farm.event(PeerUnreachable{"w1"}); // then another has its place
    CHECK(frames_of(farm, 4) == std::multiset<std::uint32_t>{1});
}

TEST_CASE("a film whose tags nobody has holds up nobody, and goes on when somebody comes") {
    Farm farm;
    for (std::uint8_t n = 1; n <= 3; ++n) {
        SubmitJob s = frame(n, 2);
        s.wishes.tags = {"gpu"};
        s.priority = 1;
        farm.submit("client", s);
    }
    farm.submit(20, 2);
    workers_arrive(farm, 1);
    CHECK(farm.tiles("w1").at(0).frame == 0);
    farm.worker_arrives("w2", 2, 1, 1, {"gpu"});
    CHECK(farm.tiles("w2").at(0).frame == 1);
}

TEST_CASE("a drained worker leaves its frame to others, and a paused frame goes to nobody") {
    Farm farm;
    for (std::uint8_t n = 1; n <= 2; ++n)
        farm.submit("client", frame(n, 3));
    farm.say("client", ControlJob{id_of<JobId>(2), JobDeed::pause, 0});
    workers_arrive(farm, 1);
    const RenderTile tile = farm.tiles("w1").at(0);
    REQUIRE(tile.frame == 1);
    farm.say("client", ControlWorker{"w1", WorkerDeed::drain});
    farm.worker_arrives("w2", 2, 1, 1);
    CHECK(farm.tiles("w2").at(0).frame == 1);
    farm.render("w1", tile);
    CHECK(farm.tiles("w1").empty());
    farm.say("client", ControlJob{id_of<JobId>(2), JobDeed::resume, 0});
    farm.say("client", ControlWorker{"w1", WorkerDeed::undrain});
    CHECK(farm.tiles("w1").at(0).frame == 1); // it was there last
}

TEST_CASE("whoever probes a frame draws it, and nobody else as long as there are others") {
    Farm farm;
    for (std::uint8_t n = 1; n <= 4; ++n)
        farm.submit("client", large_frame(n, 256));
    workers_arrive(farm, 3, 2);
    for (unsigned i = 1; i <= 3; ++i) {
        CAPTURE(i);
        const auto tiles = farm.tiles(worker(i));
        REQUIRE(tiles.size() == 2);
        CHECK(tiles[0].probe_side > 0);
        CHECK(tiles[1].probe_side == 0);
        CHECK(tiles[0].frame == i);
        CHECK(tiles[1].frame == i);
    }
}

TEST_CASE("tiles are large as long as a film has many frames, and small where it ends") {
    const auto largest = [](std::uint8_t frames, unsigned workers) {
        Farm farm;
        workers_arrive(farm, workers);
        // All machines are as fast, and that is known.
        farm.submit(100, workers * 2);
        for (unsigned i = 1; i <= workers; ++i)
            for (auto tiles = farm.tiles(worker(i)); !tiles.empty();
                 tiles = farm.tiles(worker(i))) {
                farm.now = farm.now + 5ms;
                farm.render(worker(i), tiles[0]);
            }
        for (std::uint8_t n = 1; n <= frames; ++n)
            farm.submit("client", large_frame(n, 128));
        std::uint64_t pixels = 0;
        for (unsigned i = 1; i <= workers; ++i)
            for (int tile = 0; tile < 4; ++tile)
                for (const RenderTile& order : farm.tiles(worker(i))) {
                    if (order.probe_side == 0)
                        pixels = std::max(pixels, order.rect.pixel_count());
                    farm.now = farm.now + 5ms;
                    if (order.probe_side > 0)
                        farm.fail(worker(i), order, FailureCode::cancelled);
                    else
                        farm.render(worker(i), order);
                }
        return pixels;
    };
    const std::uint64_t one_frame = largest(1, 16);
    const std::uint64_t many_frames = largest(60, 16);
    CHECK(many_frames >= 4 * one_frame);
    CHECK(largest(2, 16) <= 2 * one_frame);
}

TEST_CASE("in the end whoever is idle helps with a frame that takes long") {
    Farm farm;
    farm.submit("client", frame(1, 2));
    farm.submit("client", frame(2, 1));
    workers_arrive(farm, 2);
    const RenderTile held = farm.tiles("w1").at(0);
    farm.now = farm.now + 5ms;
    farm.render("w2", farm.tiles("w2").at(0));
    const RenderTile rest = farm.tiles("w2").at(0);
    CHECK(rest.frame == 1);
    farm.now = farm.now + 5ms;
    farm.render("w2", rest);
    farm.pass(200ms);
    const auto help = farm.tiles("w2");
    REQUIRE(help.size() == 1);
    CHECK(help[0].rect == held.rect);
    farm.render("w2", help[0]);
    CHECK(farm.state(id_of<JobId>(1)).phase == JobPhase::done);
    CHECK(farm.all<CancelTile>("w1").size() == 1);
}

TEST_CASE("a film that was forgotten leaves nothing, and its id may come back with other wishes") {
    Limits limits;
    limits.finished_jobs_max = 1;
    Farm farm(limits);
    workers_arrive(farm, 1);
    farm.submit("client", frame(1, 1));
    farm.render("w1", farm.tiles("w1").at(0));
    farm.submit(20, 1);
    farm.render("w1", farm.tiles("w1").at(0)); // the frame is forgotten
    SubmitJob s = frame(2, 1);
    s.wishes.workers_max = 1;
    farm.submit("client", s);
    CHECK(farm.tiles("w1").at(0).frame == 2);
}

TEST_CASE("after a restart the frames that are kept are one film again") {
    Farm farm({}, true);
    Restored restored;
    for (std::uint8_t n = 1; n <= 3; ++n) {
        StoredJob& job = restored.contents.jobs.emplace_back();
        job.submission = frame(n, 4);
        job.submission.wishes.workers_max = 2;
        job.number = n;
        job.phase = JobPhase::running;
    }
    restored.scenes.emplace(scene_hash, scene_bytes);
    farm.event(restored);
    CHECK(farm.state(id_of<JobId>(2)).frame == 2);
    workers_arrive(farm, 4);
    CHECK(frames_of(farm, 4) == std::multiset<std::uint32_t>{1, 2}); // two workers for all
    farm.client_arrives("client");
    farm.say("client", frame(4, 4)); // its wishes are others
    CHECK(farm.last<Refused>("client").code == RefusalCode::invalid);
}

} // namespace
} // namespace fraja::broker
