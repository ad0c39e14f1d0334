// Where more workers would not help: who has a scene goes on with it, who would have to fetch it
// first is left to others.
#include "tests/broker/farm.hpp"

namespace fraja::broker {
namespace {

using namespace protocol;
using namespace std::chrono_literals;

constexpr Duration drawing = 5ms; // a tile, as Farm::answer says

/// A farm on which one worker has drawn a picture, whose scene took it so long to fetch. Then eight
/// others come.
struct Learnt : Farm {
    explicit Learnt(Duration fetching, Limits those = {}, const PeerId& owner = "a") : Farm(those) {
        worker_arrives(owner, 1, 1, 2);
        submit(1, 6);
        draw(owner, fetching);
        draw_all(owner);
        REQUIRE(state(id_of<JobId>(1)).phase == JobPhase::done);
        for (std::uint8_t i = 2; i <= 9; ++i)
            worker_arrives("b" + std::to_string(i), i, 1, 2);
    }
    /// The oldest tile that it has; false: it has none.
    bool draw(const PeerId& peer, Duration beside = {}) {
        for (const RenderTile& tile : tiles(peer))
            waiting[peer].push_back(tile);
        if (waiting[peer].empty())
            return false;
        now = now + drawing + beside;
        const RenderTile tile = waiting[peer].front();
        waiting[peer].erase(waiting[peer].begin());
        render(peer, tile);
        return true;
    }
    void draw_all(const PeerId& peer) {
        while (draw(peer)) {
        }
    }
    void others_have_credit(std::uint32_t credit) {
        for (int i = 2; i <= 9; ++i)
            say("b" + std::to_string(i), WorkerBeat{credit, {}, 0});
    }
    JobId submit_another_scene(std::uint8_t job, std::uint32_t columns) {
        const Bytes other = to_bytes("another scene");
        SubmitJob s = picture(job, columns);
        s.scene = content_hash(other);
        s.scene_bytes = other.size();
        say("client", s);
        say("client", Chunk{s.scene, 0, other.size(), {Blob(other)}});
        return s.job;
    }
    /// By "a" alone, in no time.
    void draw_another_scene(std::uint8_t id) {
        others_have_credit(0);
        const JobId job = submit_another_scene(id, 2);
        draw_all("a");
        others_have_credit(2);
        REQUIRE(state(job).phase == JobPhase::done);
    }
    std::size_t tiles_of_others() {
        std::size_t count = 0;
        for (int i = 2; i <= 9; ++i)
            count += tiles("b" + std::to_string(i)).size();
        return count;
    }
    std::map<PeerId, std::vector<RenderTile>> waiting;
};

TEST_CASE("what is done before others have fetched the scene is left to those who have it") {
    Learnt farm(900ms);
    const JobId job = farm.submit(2, 4);
    CHECK(farm.state(job).worker_count == 1);
    farm.draw_all("a");
    CHECK(farm.tiles_of_others() == 0);
    CHECK(farm.state(job).phase == JobPhase::done);
}

TEST_CASE("where there is more to do than that everybody helps") {
    SUBCASE("as there is more of it") {
        Learnt farm(900ms);
        CHECK(farm.state(farm.submit(2, 400)).worker_count == 9);
    }
    SUBCASE("as it is fetched sooner") {
        Learnt farm(5ms);
        CHECK(farm.state(farm.submit(2, 100)).worker_count == 9);
    }
    SUBCASE("as others want the farm, too") {
        Learnt farm(250ms);
        const JobId alone = farm.submit(2, 4);
        CHECK(farm.state(alone).worker_count == 1);
        CHECK(farm.state(farm.submit(3, 4)).worker_count == 2); // other than "a", which has no room
    }
}

TEST_CASE("who has the scene and does not come to it keeps nobody waiting for longer than that") {
    for (const Duration fetching : {500ms, 2'000ms}) { // held_back_max is a second
        Learnt farm(fetching);
        const JobId job = farm.submit(2, 4);
        const Duration held = std::min<Duration>(fetching, 1s);
        farm.pass(held - 10ms);
        CHECK(farm.tiles_of_others() == 0);
        farm.pass(20ms);
        CHECK(farm.state(job).worker_count == 3); // and one each has "b2" and "b3"
        CHECK(farm.tiles_of_others() == 2);
    }
}

TEST_CASE("who would have to fetch the scene helps out where there is time for that") {
    Learnt farm(900ms);
    farm.submit(2, 1);
    farm.pass(2'300ms); // half as long again: 1.15 s, of which a quarter is to be won
    CHECK(farm.tiles_of_others() == 0);
    farm.pass(200ms);
    CHECK(farm.tiles_of_others() == 1);
}

TEST_CASE("where very many are at it the farm's mean speed is theirs") {
    for (const std::size_t count : {std::size_t{60}, std::size_t{90}}) {
        Learnt farm(900ms);
        for (std::size_t i = 0; i < count; ++i)
            farm.worker_arrives("w" + std::to_string(i), static_cast<std::uint8_t>(10 + i), 1, 1);
        // In 905 ms, when somebody else would have drawn a tile, 71 are through with eight times
        // the pixels, which that may be.
        const std::size_t enough = 71;
        CHECK(farm.state(farm.submit(2, 1'600)).worker_count == std::min(count + 9, enough));
    }
}

TEST_CASE("limits: held_back_max") {
    Limits limits;
    limits.held_back_max = 600ms;
    Learnt farm(900ms, limits);
    CHECK(farm.state(farm.submit(2, 4)).worker_count == 1);
    farm.pass(590ms);
    CHECK(farm.tiles_of_others() == 0);
    farm.pass(20ms);
    CHECK(farm.tiles_of_others() == 2);
}

TEST_CASE("a tile that failed where the scene is goes to others at once") {
    Learnt farm(900ms);
    farm.submit(2, 2);
    const auto tiles = farm.tiles("a");
    REQUIRE(tiles.size() == 2);
    farm.fail("a", tiles[0], FailureCode::machine);
    CHECK(farm.tiles_of_others() == 1);
}

TEST_CASE("what was asked for in other ways is not limited") {
    Learnt farm(900ms);
    SubmitJob s = Farm::picture(2, 8);
    SUBCASE("a schedule that deals out") {
        s.wishes.schedule = Schedule::equal;
        CHECK(farm.state(farm.submit("client", s)).worker_count == 8);
    }
    SUBCASE("as much as there is time for") {
        s.settings.time_limit = 1min;
        CHECK(farm.state(farm.submit("client", s)).worker_count == 9);
    }
    SUBCASE("a film, whose frames everybody has to fetch") {
        s.wishes.film = id_of<FilmId>(1);
        s.wishes.frame = 1;
        CHECK(farm.state(farm.submit("client", s)).worker_count == 8);
    }
}

TEST_CASE("nothing is held back while nobody knows how fast a farm is") {
    Farm farm;
    for (std::uint8_t i = 1; i <= 9; ++i)
        farm.worker_arrives("w" + std::to_string(i), i, 10'000, 1); // nor is it by its threads
    CHECK(farm.state(farm.submit(1, 9)).worker_count == 9);
}

TEST_CASE("whose connection ends has its scenes no more") {
    Learnt farm(900ms);
    farm.say("a", Goodbye{});
    farm.worker_arrives("z", 1, 1, 2);
    const JobId job = farm.submit(2, 4);
    CHECK(farm.tiles("z").empty()); // nobody has it: so it is at whoever is first
    CHECK(farm.state(job).worker_count == 1);
}

TEST_CASE("limits: remembered_scenes_max") {
    for (const std::size_t remembered : {std::size_t{1}, std::size_t{2}}) {
        Limits limits;
        limits.remembered_scenes_max = remembered;
        Learnt farm(900ms, limits);
        farm.draw_another_scene(2);
        // "b2" draws the first one, and "a" may help it if it still has it.
        farm.say("a", WorkerBeat{0, {}, 8});
        farm.submit(3, 4);
        CHECK(farm.tiles("b2").size() == 2);
        farm.say("a", WorkerBeat{2, {}, 8});
        CHECK(farm.tiles("a").size() == (remembered == 2 ? 2 : 0));
    }
}

TEST_CASE("limits: fetch_times_max") {
    for (const std::size_t known : {std::size_t{1}, std::size_t{2}}) {
        Limits limits;
        limits.fetch_times_max = known;
        Learnt farm(900ms, limits);
        farm.draw_another_scene(2);
        CHECK(farm.state(farm.submit(3, 4)).worker_count == (known == 2 ? 1 : 4));
    }
}

TEST_CASE("how long one scene takes tells nothing of another") {
    Learnt farm(900ms);
    farm.draw_another_scene(2);
    CHECK(farm.state(farm.submit(3, 4)).worker_count == 1);
}

TEST_CASE("who comes back with the scene at hand does not make it look small") {
    Learnt farm(900ms);
    farm.say("a", Goodbye{});
    farm.others_have_credit(0);
    farm.worker_arrives("a", 1, 1, 2);
    farm.submit(2, 6);
    farm.draw_all("a");
    farm.others_have_credit(2);
    CHECK(farm.state(farm.submit(3, 4)).worker_count == 1);
}

TEST_CASE("who was busy when it was given a scene's first tile does not make it look large") {
    Learnt farm(0ms);
    farm.others_have_credit(0);
    farm.submit(2, 1);
    farm.submit_another_scene(3, 1);
    REQUIRE(farm.draw("a", 900ms)); // of the first scene, while the other tile waits
    REQUIRE(farm.draw("a"));
    farm.others_have_credit(2);
    CHECK(farm.state(farm.submit_another_scene(4, 4)).worker_count > 1);
}

TEST_CASE("a fetch that did not come to its end is none") {
    Learnt farm(900ms);
    farm.say("a", Goodbye{});
    const JobId job = farm.submit(2, 2); // "b2" has it
    auto tiles = farm.tiles("b2");
    REQUIRE(tiles.size() == 2);
    farm.say("client", ControlJob{job, JobDeed::cancel});
    for (const RenderTile& tile : tiles)
        farm.fail("b2", tile, FailureCode::cancelled);
    farm.worker_arrives("a2", 10, 1, 2);
    farm.submit(3, 2);
    CHECK(farm.tiles("a2").size() == 2); // before "b2", which is as new to it
}

TEST_CASE("who has the scene is the first to be asked, whatever its name") {
    SUBCASE("where nobody is at the job") {
        Learnt farm(900ms, {}, "z");
        farm.submit(2, 2);
        CHECK(farm.tiles("z").size() == 2);
    }
    SUBCASE("while it is at the probe") {
        Learnt farm(900ms, {}, "z");
        SubmitJob s = Farm::picture(2, 1);
        s.settings.size = {64, 32};
        s.settings.crop = {0, 0, 64, 32};
        s.tile_side = 0;
        farm.submit("client", s);
        const auto tiles = farm.tiles("z");
        REQUIRE(tiles.size() == 2);
        CHECK(tiles[0].probe_side > 0);
        CHECK(farm.tiles_of_others() == 0);
    }
    SUBCASE("where help is wanted") {
        Learnt farm(900ms);
        farm.others_have_credit(0);
        farm.worker_arrives("z", 10, 8, 16);
        farm.submit(2, 400);
        for (int i = 0; i < 400; ++i)
            if (!farm.draw("z"))
                farm.draw("a");
        REQUIRE(farm.state(id_of<JobId>(2)).phase == JobPhase::done);
        farm.others_have_credit(2);
        farm.draw_all("a");
        farm.draw_all("z");
        farm.tiles_of_others();
        farm.beat("z", 0, {});
        farm.submit(3, 1);
        REQUIRE(farm.tiles("a").size() == 1);
        farm.beat("z", 16, {});
        farm.pass(200ms);
        CHECK(farm.tiles("z").size() == 1);
        CHECK(farm.tiles_of_others() == 0);
    }
}

} // namespace
} // namespace fraja::broker
