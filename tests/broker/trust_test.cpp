// Tiles that a second worker draws as well, and a worker whose pixels are wrong.
#include "common/protocol/limits.hpp"
#include "tests/broker/fleet.hpp"

#include <memory>
#include <set>
#include <string_view>

namespace fraja::broker {
namespace {

using namespace protocol;
using namespace std::chrono_literals;

/// Liars that do not agree have each another number.
TileRendered lie(const RenderTile& tile, std::uint8_t number = 1) {
    TileRendered answer = Farm::answer(tile);
    Bytes pixels(byte_count(answer.blobs));
    pixels.back() = std::byte{number};
    answer.blobs = {Blob(std::move(pixels))};
    return answer;
}

bool is_lie(const TileDone& tile) {
    return joined(tile.blobs).data()[byte_count(tile.blobs) - 1] == std::byte{1};
}

/// They answer what they are given, `liars` wrongly, until nobody is given anything.
void work(Farm& farm, const std::vector<PeerId>& workers, const std::set<PeerId>& liars = {}) {
    for (bool any = true; any;) {
        any = false;
        for (const PeerId& peer : workers) {
            const auto given = farm.tiles(peer);
            for (const RenderTile& tile : given) {
                any = true;
                if (liars.contains(peer))
                    farm.say(peer, lie(tile));
                else
                    farm.render(peer, tile);
            }
        }
    }
}

bool logged(const Farm& farm, const std::string& kind) {
    return std::ranges::any_of(farm.logs, [&](const Log& line) { return line.kind == kind; });
}

/// What a watcher that has nothing is given of the job.
std::vector<TileDone> picture_of(Farm& farm, const JobId& job) {
    farm.client_arrives("watcher");
    farm.forget("watcher");
    farm.say("watcher", Repair{job, 1000, {}});
    return farm.all<TileDone>("watcher");
}

TEST_CASE("every tile of --verify 1 is drawn by two workers before the job is done") {
    Farm farm;
    farm.worker_arrives("a", 1, 1, 2);
    const JobId job = farm.submit("client", Farm::checked(1, 4));
    const auto first = farm.tiles("a");
    farm.worker_arrives("b", 2, 1, 2);
    for (const RenderTile& tile : first)
        farm.render("a", tile);
    work(farm, {"a"});
    CHECK(farm.state(job).done_count < 4); // b has some
    work(farm, {"a", "b"});
    const JobState state = farm.state(job);
    CHECK(state.phase == JobPhase::done);
    CHECK(state.checks == CheckCounts{4, 0});
    CHECK(state.distrusted.empty());
    CHECK(farm.dispatcher.counters().tiles_sent == 8);
    CHECK(farm.dispatcher.counters().tiles_checked == 4);
    CHECK(farm.dispatcher.counters().tiles_done == 4);
}

TEST_CASE("a job that is not checked is given out once") {
    Farm farm;
    farm.worker_arrives("a", 1, 1, 2);
    farm.worker_arrives("b", 2, 1, 2);
    const JobId job = farm.submit(1, 20);
    work(farm, {"a", "b"});
    CHECK(farm.state(job).phase == JobPhase::done);
    CHECK(farm.dispatcher.counters().tiles_sent == 20);
}

TEST_CASE("the share of tiles that is checked is the one that was asked for") {
    Farm farm;
    farm.worker_arrives("a", 1, 1, 8);
    farm.worker_arrives("b", 2, 1, 8);
    const JobId job = farm.submit("client", Farm::checked(1, 1000, 0.1));
    work(farm, {"a", "b"});
    const CheckCounts checks = farm.state(job).checks;
    CHECK(checks.agreed > 70);
    CHECK(checks.agreed < 130);
    CHECK(checks.unchecked == 0);
}

bool says(const std::string& text, std::string_view words) {
    return text.find(words) != std::string::npos;
}

Holder key_of(const std::string& name) {
    return std::make_shared<KeyHolder>(KeyHolder{"key of " + name, name, {Role::worker}});
}

TEST_CASE("workers of one key have one voice, whatever they call themselves") {
    Farm farm;
    farm.worker_arrives("a", 1, 1, 2, {}, key_of("mallory"));
    farm.worker_arrives("b", 2, 1, 2, {}, key_of("mallory"));
    SUBCASE("they do not check each other") {
        const JobId job = farm.submit("client", Farm::checked(1, 6));
        work(farm, {"a", "b"}, {"a", "b"});
        CHECK(farm.state(job).phase == JobPhase::done);
        CHECK(farm.state(job).checks == CheckCounts{0, 6});
        CHECK(std::ranges::any_of(farm.logs, [](const Log& line) {
            return says(line.text, "there is no second worker with another key");
        }));
    }
    SUBCASE("they do not win against one of another key") {
        farm.worker_arrives("c", 3, 1, 2, {}, key_of("ada"));
        const JobId job = farm.submit("client", Farm::checked(1, 6));
        work(farm, {"a", "b", "c"}, {"a", "b"});
        CHECK(farm.state(job).phase == JobPhase::running);
        CHECK(farm.state(job).distrusted.empty());
        CHECK(says(farm.state(job).reason, "one more worker"));
        // The third one tells: all that has the key of those that lie is out at once.
        farm.worker_arrives("d", 4, 1, 2, {}, key_of("eve"));
        work(farm, {"a", "b", "c", "d"}, {"a", "b"});
        const JobState state = farm.state(job);
        CHECK(state.phase == JobPhase::done);
        REQUIRE(state.distrusted.size() == 1);
        CHECK(state.distrusted[0].worker == drawer_of({}, key_of("mallory")));
        CHECK(farm.dispatcher.figures().workers_distrusted == 2);
        CHECK(std::ranges::none_of(picture_of(farm, job), is_lie));
        CHECK(std::ranges::any_of(farm.logs, [](const Log& line) {
            return line.kind == "worker_distrusted" &&
                   says(line.text, "which has the key of mallory,");
        }));
        // A new process with a new name is the same one.
        farm.say("a", Goodbye{});
        farm.worker_arrives("new", 9, 1, 2, {}, key_of("mallory"));
        const JobId next = farm.submit("client", Farm::checked(2, 6));
        work(farm, {"c", "d"});
        CHECK(farm.tiles("new").empty());
        CHECK(farm.state(next).phase == JobPhase::done);
    }
}

TEST_CASE(
    "limits: liars_max: a liar stays one when its jobs are forgotten, until it is taken back") {
    Limits limits;
    limits.liars_max = 1;
    limits.finished_jobs_max = 1;
    Farm farm(limits);
    const auto come = [&](const PeerId& peer, std::uint8_t id, const std::string& key) {
        farm.worker_arrives(peer, id, 1, 2, {}, key_of(key));
    };
    come("a", 1, "ada");
    come("b", 2, "mallory");
    come("c", 3, "eve");
    JobId job = farm.submit("client", Farm::checked(1, 6));
    work(farm, {"a", "b", "c"}, {"b"});
    REQUIRE(farm.state(job).distrusted.size() == 1);
    const auto end_another = [&] { // and the job that tells of it is forgotten
        const JobId other = farm.submit("client", Farm::picture(8, 1));
        work(farm, {"a", "c"});
        REQUIRE(farm.state(other).phase == JobPhase::done);
    };
    const auto is_given_any = [&](const PeerId& peer, std::uint8_t number) {
        (void)farm.submit(number, 40);
        const bool any = !farm.tiles(peer).empty();
        return any;
    };
    SUBCASE("it is forgotten by nobody") {
        end_another();
        come("b2", 9, "mallory");
        CHECK_FALSE(is_given_any("b2", 5));
    }
    SUBCASE("who was taken back is so in a new process, too") {
        farm.say("client", ControlWorker{"b", WorkerDeed::undrain});
        farm.say("b", Goodbye{});
        come("b2", 9, "mallory");
        CHECK(is_given_any("b2", 5));
    }
    SUBCASE("of one too many its jobs alone tell") {
        come("d", 4, "trudy");
        job = farm.submit("client", Farm::checked(2, 12));
        work(farm, {"a", "c", "d"}, {"d"});
        REQUIRE(farm.state(job).distrusted.size() == 1);
        end_another();
        come("d2", 9, "trudy");
        CHECK(is_given_any("d2", 5));
    }
}

TEST_CASE("machines that share a key check each other, and one of them is distrusted alone") {
    const auto shared =
        std::make_shared<KeyHolder>(KeyHolder{"key of all", "machines", {Role::worker}, true});
    Farm farm;
    for (const char* name : {"a", "b", "c"})
        farm.worker_arrives(name, static_cast<std::uint8_t>(name[0] - 'a' + 1), 1, 2, {}, shared);
    const JobId job = farm.submit("client", Farm::checked(1, 6));
    work(farm, {"a", "b", "c"}, {"b"});
    const JobState state = farm.state(job);
    CHECK(state.phase == JobPhase::done);
    CHECK(state.checks == CheckCounts{6, 0});
    REQUIRE(state.distrusted.size() == 1);
    CHECK(state.distrusted[0].worker_name == "b");
    CHECK(farm.dispatcher.figures().workers_distrusted == 1);
    CHECK(std::ranges::none_of(picture_of(farm, job), is_lie));
}

TEST_CASE("two keys are two, even where their workers have one name") {
    Farm farm;
    for (const char* who : {"ada", "eve"}) {
        WorkerHello hello;
        hello.worker = id_of<WorkerId>(who[0] == 'a' ? 1 : 2);
        hello.incarnation = 1;
        hello.worker_name = "render";
        hello.threads = 1;
        hello.credit = 2;
        farm.event(PeerSaid{who, hello, key_of(who)});
    }
    const JobId job = farm.submit("client", Farm::checked(1, 6));
    work(farm, {"ada", "eve"});
    CHECK(farm.state(job).checks == CheckCounts{6, 0});
}

TEST_CASE("without a second worker a job ends, and says what was not checked") {
    Farm farm;
    farm.worker_arrives("a", 1, 1, 2);
    const JobId job = farm.submit("client", Farm::checked(1, 3));
    SUBCASE("there never was one") {
        work(farm, {"a"});
    }
    SUBCASE("it has gone") {
        farm.worker_arrives("b", 2, 1, 1);
        const auto left = farm.tiles("b");
        farm.say("b", Goodbye{});
        work(farm, {"a"});
    }
    SUBCASE("it goes when all is drawn") {
        farm.worker_arrives("b", 2, 1, 3);
        work(farm, {"a"});
        for (const RenderTile& tile : farm.tiles("b"))
            farm.say("b",
                     TileFailed{tile.job, tile.tile, tile.attempt, FailureCode::cancelled, ""});
        work(farm, {"a"});
        farm.say("b", Goodbye{});
        work(farm, {"a"});
    }
    farm.pass(farm.limits.heartbeat);
    const JobState state = farm.state(job);
    CHECK(state.phase == JobPhase::done);
    CHECK(state.checks == CheckCounts{0, 3});
    CHECK(logged(farm, "tiles_unchecked"));
    CHECK(farm.dispatcher.counters().tiles_unchecked == 3);
}

TEST_CASE(
    "a worker that answers wrong pixels is named, gets nothing, and its tiles are drawn anew") {
    Farm farm;
    for (std::uint8_t i = 1; i <= 3; ++i)
        farm.worker_arrives(std::string(1, static_cast<char>('a' + i - 1)), i, 1, 2);
    const JobId job = farm.submit("client", Farm::checked(1, 12));
    farm.subscribe(job);
    work(farm, {"a", "b", "c"}, {"b"});
    const JobState state = farm.state(job);
    CHECK(state.phase == JobPhase::done);
    REQUIRE(state.distrusted.size() == 1);
    CHECK(state.distrusted[0].worker == id_of<WorkerId>(2));
    CHECK(state.distrusted[0].worker_name == "b");
    CHECK(state.distrusted[0].reason.find("two others have drawn the same") != std::string::npos);
    CHECK(logged(farm, "worker_distrusted"));
    CHECK(farm.dispatcher.counters().workers_distrusted == 1);
    CHECK(state.checks.agreed == 12);
    const auto picture = picture_of(farm, job);
    CHECK(picture.size() == 12);
    for (const TileDone& tile : picture)
        CHECK_FALSE(is_lie(tile));
    // What it had drawn was published before that.
    const auto published = farm.published<TileDone>(job_topic(job));
    CHECK(std::ranges::any_of(published, is_lie));
    CHECK(published.size() > 12);

    (void)farm.tiles("b");
    const JobId next = farm.submit(2, 6);
    CHECK(farm.tiles("b").empty());
    work(farm, {"a", "c"});
    CHECK(farm.state(next).phase == JobPhase::done);
}

TEST_CASE("a liar gets nothing, even if it is the last one, until somebody takes it back") {
    Farm farm;
    for (std::uint8_t i = 1; i <= 3; ++i)
        farm.worker_arrives(std::string(1, static_cast<char>('a' + i - 1)), i, 1, 2);
    (void)farm.submit("client", Farm::checked(1, 12));
    work(farm, {"a", "b", "c"}, {"b"});
    farm.say("a", Goodbye{});
    farm.say("c", Goodbye{});
    const JobId next = farm.submit(2, 2);
    const auto beats = [&](Duration time) {
        for (const Instant end = farm.now + time; farm.now < end;) {
            farm.pass(farm.limits.heartbeat / 2);
            farm.beat("b", 2, {});
            farm.client_arrives("client");
        }
    };
    beats(2 * farm.limits.quarantine_window);
    CHECK(farm.tiles("b").empty());
    CHECK(farm.state(next).reason.find("may be given tiles") != std::string::npos);
    SUBCASE("it says hello again") {
        farm.worker_arrives("b", 2, 1, 2);
        CHECK(farm.tiles("b").empty());
    }
    SUBCASE("it comes back") {
        farm.event(PeerUnreachable{"b"});
        farm.worker_arrives("b2", 2, 1, 2);
        CHECK(farm.tiles("b2").empty());
    }
    SUBCASE("it is taken back") {
        farm.say("client", ControlWorker{"b", WorkerDeed::undrain});
        CHECK_FALSE(farm.tiles("b").empty());
    }
}

TEST_CASE("what a liar has drawn for other jobs is drawn again, too") {
    Farm farm;
    farm.worker_arrives("b", 2, 1, 2);
    const JobId other = farm.submit(2, 40); // is not checked
    for (int i = 0; i < 3; ++i)
        for (const RenderTile& tile : farm.tiles("b"))
            farm.say("b", lie(tile));
    CHECK(farm.state(other).done_count > 3);
    (void)farm.submit("client", Farm::checked(1, 6));
    farm.worker_arrives("a", 1, 1, 2);
    farm.worker_arrives("c", 3, 1, 2);
    work(farm, {"a", "b", "c"}, {"b"});
    const JobState state = farm.state(other);
    CHECK(state.phase == JobPhase::done);
    CHECK(state.distrusted.size() == 1);
    for (const TileDone& tile : picture_of(farm, other))
        CHECK_FALSE(is_lie(tile));
}

TEST_CASE("two workers that disagree draw it again, and then a third is waited for in words") {
    Farm farm;
    farm.worker_arrives("a", 1, 1, 1);
    farm.worker_arrives("b", 2, 1, 1);
    const JobId job = farm.submit("client", Farm::checked(1, 2));
    work(farm, {"a", "b"}, {"b"});
    farm.pass(farm.limits.heartbeat / 2);
    JobState state = farm.state(job);
    CHECK(state.phase == JobPhase::running);
    CHECK(state.done_count == 2);
    CHECK(state.reason.find("have drawn different pixels") != std::string::npos);
    CHECK(state.reason.find("one more worker") != std::string::npos);
    CHECK(logged(farm, "tile_contested"));
    farm.worker_arrives("c", 3, 1, 1);
    work(farm, {"a", "b", "c"}, {"b"});
    state = farm.state(job);
    CHECK(state.phase == JobPhase::done);
    REQUIRE(state.distrusted.size() == 1);
    CHECK(state.distrusted[0].worker_name == "b");
    for (const TileDone& tile : picture_of(farm, job))
        CHECK_FALSE(is_lie(tile));
}

TEST_CASE("limits: contest_interval") {
    // The only one who could tell who is right has failed to draw the tile, and may not fail again.
    Farm farm;
    farm.worker_arrives("a", 1, 1, 1);
    const JobId job = farm.submit("client", Farm::checked(1, 1));
    farm.worker_arrives("b", 2, 1, 1);
    farm.render("a", farm.tiles("a").at(0));
    farm.say("b", lie(farm.tiles("b").at(0)));
    farm.worker_arrives("c", 3, 1, 1);
    // How long it takes until that one is asked; at most, if it is not.
    std::vector<RenderTile> given;
    const auto asked_after = [&](Duration most) {
        const Instant begin = farm.now;
        for (given = farm.tiles("c"); given.empty() && farm.now < begin + most;
             given = farm.tiles("c")) {
            for (const char* peer : {"a", "b", "c"})
                farm.beat(peer, 1, {});
            farm.pass(farm.limits.heartbeat / 2);
        }
        return farm.now - begin;
    };
    for (const Duration expected : {0s, 0s, 9s}) { // the first time that all are through, at once
        CHECK(asked_after(30s) >= expected);
        REQUIRE_FALSE(given.empty());
        farm.fail("c", given[0], FailureCode::machine);
        work(farm, {"a", "b"}, {"b"}); // each says once more what it has said
    }
    CHECK(asked_after(5s) >= 5s);
    CHECK(farm.state(job).reason.find("one more worker") != std::string::npos);
    CHECK(asked_after(30s) < 6s);
    REQUIRE_FALSE(given.empty());
    farm.render("c", given[0]);
    work(farm, {"a", "c"});
    const JobState state = farm.state(job);
    CHECK(state.phase == JobPhase::done);
    REQUIRE(state.distrusted.size() == 1);
    CHECK(state.distrusted[0].worker_name == "b");
}

TEST_CASE("of two workers the one is found out that does not say the same twice") {
    Farm farm;
    farm.worker_arrives("a", 1, 1, 1);
    const JobId job = farm.submit("client", Farm::checked(1, 1));
    farm.worker_arrives("b", 2, 1, 1);
    farm.say("a", lie(farm.tiles("a").at(0))); // once
    work(farm, {"a", "b"});
    farm.pass(farm.limits.heartbeat / 2);
    work(farm, {"a", "b"});
    farm.pass(farm.limits.heartbeat / 2);
    const JobState state = farm.state(job);
    CHECK(state.phase == JobPhase::done);
    REQUIRE(state.distrusted.size() == 1);
    CHECK(state.distrusted[0].worker_name == "a");
    CHECK(state.checks.unchecked == 1); // there is nobody left who could
}

TEST_CASE("what a broker keeps does not bring a liar's tiles back") {
    Farm farm({}, true);
    for (std::uint8_t i = 1; i <= 3; ++i)
        farm.worker_arrives(std::string(1, static_cast<char>('a' + i - 1)), i, 1, 2);
    std::uint64_t stored = 0;
    const auto store = [&] {
        if (farm.persisted.back().sequence > stored)
            farm.event(Stored{stored = farm.persisted.back().sequence});
    };
    const SubmitJob submission = Farm::checked(1, 12);
    const JobId job = farm.submit("client", submission);
    store();
    for (int i = 0; i < 8; ++i) {
        for (const PeerId peer : {"a", "b", "c"})
            for (const RenderTile& tile : farm.tiles(peer))
                farm.say(peer, peer == "b" ? lie(tile) : Farm::answer(tile));
        store();
    }
    std::vector<PutDistrusted> put;
    for (const Persist& persist : farm.persisted)
        if (const auto* one = std::get_if<PutDistrusted>(&persist.write))
            put.push_back(*one);
    REQUIRE(put.size() == 1);
    CHECK(put[0].worker.worker == id_of<WorkerId>(2));
    CHECK_FALSE(put[0].tiles.empty());

    // A broker that finds only what b has drawn, and that it is not to be believed.
    Farm next({}, true);
    StoredJob kept;
    kept.submission = submission;
    kept.number = 1;
    kept.phase = JobPhase::running;
    kept.distrusted = {put[0].worker};
    kept.tiles.push_back({.tile = TileIndex{0},
                          .rect = {0, 0, 10, 10},
                          .rays = {},
                          .worker = id_of<WorkerId>(2),
                          .worker_name = "b"});
    kept.tiles.push_back({.tile = TileIndex{1},
                          .rect = {10, 0, 10, 10},
                          .rays = {},
                          .worker = id_of<WorkerId>(1),
                          .worker_name = "a",
                          .pixels = content_hash(Bytes(1200))});
    Restored restored;
    restored.contents.jobs.push_back(kept);
    restored.scenes[scene_hash] = scene_bytes;
    next.event(restored);
    CHECK(next.state(job).done_count == 1);
    next.worker_arrives("b", 2, 1, 2);
    CHECK(next.tiles("b").empty());
    next.worker_arrives("a", 1, 1, 2);
    next.worker_arrives("c", 3, 1, 2);
    work(next, {"a", "c"});
    const JobState state = next.state(job);
    CHECK(state.phase == JobPhase::done);
    CHECK(state.checks == CheckCounts{12, 0}); // also what was drawn under the other broker
}

TEST_CASE("what several brokers have of a liar does not come back from any of them") {
    Fleet fleet(2);
    fleet.pass(3s);
    REQUIRE(fleet.leaders().size() == 1);
    const std::size_t leader = fleet.leaders()[0], other = 1 - leader;
    for (std::uint8_t i = 1; i <= 3; ++i)
        fleet.worker_arrives(std::string(1, static_cast<char>('a' + i - 1)), i, 2);
    fleet.pass(1s);
    const JobId job = fleet.submit(leader, "client", Farm::checked(1, 12));
    fleet.liar = "b";
    for (int i = 0; i < 40; ++i) {
        for (const char* name : {"a", "b", "c"})
            fleet.render_all(name);
        fleet.pass(100ms);
    }
    fleet.pass(3s);
    for (const std::size_t i : {leader, other}) {
        CAPTURE(i);
        const auto state = fleet.state(i, job);
        REQUIRE(state);
        CHECK(state->phase == JobPhase::done);
        REQUIRE(state->distrusted.size() == 1);
        CHECK(state->distrusted[0].worker_name == "b");
        fleet.sent.clear();
        fleet.say(i, "watcher", ClientHello{"watcher", "test"});
        fleet.say(i, "watcher", Repair{job, 1000, {}});
        const auto tiles = fleet.heard<TileDone>(i, "watcher");
        CHECK(tiles.size() == 12);
        for (const TileDone& tile : tiles)
            CHECK_FALSE(is_lie(tile));
    }
}

TEST_CASE("checks that make no sense are refused in words") {
    Farm farm;
    struct Row {
        void (*spoil)(SubmitJob&);
        const char* words;
    };
    for (const Row& row : {Row{[](SubmitJob& s) { s.wishes.verify = 1.5; }, "0 to 1"},
                           Row{[](SubmitJob& s) { s.wishes.verify = -1; }, "0 to 1"},
                           Row{[](SubmitJob& s) { s.settings.time_limit = 5s; }, "time limit"},
                           Row{[](SubmitJob& s) { s.wishes.workers_max = 1; }, "two workers"}}) {
        SubmitJob s = Farm::checked(1, 2);
        row.spoil(s);
        farm.client_arrives("client");
        farm.forget("client");
        farm.say("client", s);
        CHECK(farm.last<Refused>("client").reason.find(row.words) != std::string::npos);
    }
}

TEST_CASE("a job that would distrust more than distrusted_max workers fails") {
    Farm farm(Limits{.workers_max = 2 * distrusted_max});
    const JobId job = farm.submit("client", Farm::checked(1, distrusted_max + 1));
    // Each draws one tile wrongly; two honest ones find that out.
    for (std::uint8_t i = 0; i <= distrusted_max; ++i)
        farm.worker_arrives("liar" + std::to_string(i), static_cast<std::uint8_t>(10 + i), 1, 1);
    farm.worker_arrives("a", 1, 1, 1);
    farm.worker_arrives("b", 2, 1, 1);
    for (std::uint8_t i = 0; i <= distrusted_max; ++i)
        farm.say("liar" + std::to_string(i), lie(farm.tiles("liar" + std::to_string(i)).at(0),
                                                 static_cast<std::uint8_t>(i + 1)));
    for (std::uint8_t i = 0; i <= distrusted_max; ++i)
        farm.beat("liar" + std::to_string(i), 0, {}); // leaves, and has nothing any more
    work(farm, {"a", "b"});
    const JobState state = farm.state(job);
    CHECK(state.phase == JobPhase::failed);
    CHECK(state.reason == "more than 64 workers have answered wrong pixels");
    CHECK(state.distrusted.size() == distrusted_max);
    farm.say("client", ControlJob{job, JobDeed::retry, 0});
    const auto refused = farm.last<Refused>("client");
    CHECK(refused.code == RefusalCode::limit_exceeded);
    CHECK(refused.reason == "64 workers have answered wrong pixels for it: submit it again");
    CHECK(farm.state(job).phase == JobPhase::failed);
}

} // namespace
} // namespace fraja::broker
