#include "client/follower.hpp"

#include "client/watching.hpp"
#include "common/protocol/passes.hpp"
#include "tests/client/fake_farm.hpp"
#include "tests/support/seeds.hpp"

#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::client;
using namespace std::chrono_literals;

namespace {

WatchRequest watch_request() {
    return {"cone", {{"tcp://127.0.0.1:50057"}, 60s, "test"}, {}};
}

/// Every tile that is done came exactly once, with its own pixels.
void check_delivered(const FakeFarm& farm, std::uint32_t count) {
    CHECK(farm.pixels_right);
    CHECK(farm.delivered.size() == count);
    for (const auto& [tile, times] : farm.delivered) {
        CAPTURE(tile);
        CHECK(times == 1);
    }
}

protocol::JobState job_of_four_tiles() {
    protocol::JobState state;
    state.job = JobId{{1}};
    state.epoch = 1;
    state.phase = protocol::JobPhase::running;
    state.settings.size = {4, 1};
    state.settings.crop = {0, 0, 4, 1};
    state.cell_side = 1;
    state.cell_count = 4;
    return state;
}

protocol::TileDone tile_of(const protocol::JobState& job, std::uint32_t tile) {
    protocol::TileDone done;
    done.job = job.job;
    done.tile = TileIndex{tile};
    done.rect = {tile, 0, 1, 1};
    done.blobs = {Blob(Bytes(12))};
    return done;
}

/// The one action of that type, if there is exactly one: a look into `actions`.
template <class A>
const A* only(const std::vector<Action>& actions) {
    const A* found = nullptr;
    for (const Action& action : actions)
        if (const auto* a = std::get_if<A>(&action)) {
            if (found)
                return nullptr;
            found = a;
        }
    return found;
}

std::optional<protocol::Repair> repair_in(const std::vector<Action>& actions) {
    const auto* send = only<Send>(actions);
    const auto* repair = send ? std::get_if<protocol::Repair>(&send->message) : nullptr;
    return repair ? std::optional(*repair) : std::nullopt;
}

Nonce nonce_in(const std::vector<Action>& actions) {
    for (const Action& action : actions)
        if (const auto* subscribe = std::get_if<Subscribe>(&action))
            if (const auto nonce = protocol::topic_id<Nonce>('N', subscribe->topic))
                return *nonce;
    FAIL("no nonce was subscribed");
    return {};
}

/// A follower past its barrier and its first, empty repair, at 0 s.
struct Following {
    protocol::JobState job = job_of_four_tiles();
    Follower follower{job, Rng(1)};
    std::vector<Action> actions;
    Instant now{};

    Following() {
        follower.start(now, actions);
        step(FromStream{protocol::Barrier{nonce_in(actions), 1}});
        CHECK(repair_in(actions).has_value());
        step(FromBroker{protocol::RepairDone{job, 0}});
    }
    void step(const Event& event) {
        actions.clear();
        follower.step(now, event, actions);
    }
};

} // namespace

TEST_CASE("what was sent in an epoch before counts no more where the job is checked") {
    for (const double verify : {0.0, 0.5}) {
        Following f;
        f.job.epoch = 2;
        f.job.verify = verify;
        f.step(FromStream{f.job});
        protocol::TileDone tile = tile_of(f.job, 0);
        tile.epoch = 1; // it came by another way than the job's state
        f.step(FromBroker{tile});
        CHECK(f.follower.have_count() == (verify > 0 ? 0 : 1));
        tile.epoch = 2;
        f.step(FromBroker{tile});
        CHECK(f.follower.have_count() == 1);
        tile = tile_of(f.job, 1); // it is not known when
        f.step(FromBroker{tile});
        CHECK(f.follower.have_count() == 2);
        tile = tile_of(f.job, 2);
        tile.epoch = 3; // of which the job's state has not come
        f.step(FromStream{tile});
        CHECK(f.follower.have_count() == (verify > 0 ? 2 : 3));
    }
}

TEST_CASE("an epoch that nobody has any more is not waited for for ever") {
    for (const double verify : {0.0, 0.5}) {
        CAPTURE(verify);
        Following f;
        f.job.epoch = 9; // of a broker that has died since, and nobody else had heard of
        f.job.verify = verify;
        f.step(FromStream{f.job});
        protocol::TileDone tile = tile_of(f.job, 0);
        tile.epoch = 9;
        f.step(FromStream{tile});
        REQUIRE(f.follower.have_count() == 1);
        f.job.epoch = 8;
        f.step(FromBroker{protocol::RepairDone{f.job, 0}});
        f.now = f.now + 9s;
        f.step(FromStream{f.job}); // late, perhaps
        f.step(FromBroker{protocol::RepairDone{f.job, 0}});
        CHECK(f.follower.state().epoch == 9);
        f.now = f.now + 1s;
        f.step(FromStream{f.job});
        CHECK(f.follower.state().epoch == 9);
        f.step(FromBroker{protocol::RepairDone{f.job, 0}});
        CHECK(f.follower.state().epoch == 8);
        CHECK(f.follower.have_count() == (verify > 0 ? 0 : 1));
    }
}

TEST_CASE("what a distrusted worker has drawn is missing again, and comes from others") {
    Following f;
    const auto from = [&](std::uint32_t tile, std::uint8_t worker) {
        protocol::TileDone done = tile_of(f.job, tile);
        done.worker = WorkerId{{worker}};
        return done;
    };
    for (std::uint32_t tile = 0; tile < 4; ++tile)
        f.step(FromStream{from(tile, tile % 2 == 0 ? 1 : 2)});
    REQUIRE(f.follower.have_count() == 4);

    f.job.done_count = 4;
    f.step(FromStream{f.job});
    f.job.done_count = 2;
    f.job.distrusted = {{WorkerId{{2}}, "b", "it lies"}};
    f.step(FromStream{f.job});
    CHECK(f.follower.have_count() == 2);
    REQUIRE_FALSE(f.actions.empty());
    const auto* news = std::get_if<News>(f.actions.data());
    const auto* withdrawn = news ? std::get_if<TilesWithdrawn>(news) : nullptr;
    REQUIRE(withdrawn);
    CHECK(withdrawn->rects == std::vector{PixelRect{1, 0, 1, 1}, PixelRect{3, 0, 1, 1}});
    CHECK(withdrawn->worker_name == "b");

    f.step(FromStream{from(1, 2)}); // is still under way
    CHECK(f.actions.empty());
    CHECK(f.follower.have_count() == 2);
    CHECK(f.follower.counts().distrusted == 1);
    protocol::JobState before = f.job;
    before.distrusted.clear();
    before.done_count = 4;
    f.step(FromStream{before}); // was said before
    CHECK(f.follower.state().distrusted.size() == 1);

    f.step(FromStream{from(1, 3)});
    CHECK(f.follower.have_count() == 3);
    f.job.phase = protocol::JobPhase::done;
    f.job.done_count = 4;
    f.step(FromStream{f.job});
    CHECK_FALSE(f.follower.is_complete());                // one was dropped
    CHECK(f.follower.next_deadline() < Instant::never()); // it is asked for
    f.step(FromBroker{from(3, 1)});
    CHECK(f.follower.is_complete());
}

TEST_CASE("whom only a broker distrusts that is gone counts in the end as the others have it") {
    Following f;
    const WorkerId liar{{2}};
    const auto tile = [&](std::uint32_t index) {
        protocol::TileDone done = tile_of(f.job, index);
        done.worker = index == 1 ? liar : WorkerId{{1}};
        return done;
    };
    f.job.phase = protocol::JobPhase::done;
    f.job.done_count = 4;
    protocol::JobState gone = f.job;
    gone.distrusted = {{liar, "b", "it lies"}};
    f.step(FromStream{gone});
    int asked = 0;
    for (; asked < 100 && !f.follower.is_complete(); ++asked) {
        f.now = f.now + 1s;
        f.step(Tick{});
        for (std::uint32_t i = 0; i < 4; ++i)
            f.step(FromBroker{tile(i)});
        f.step(FromBroker{protocol::RepairDone{f.job, 0}});
    }
    CHECK(asked > 4);
    CHECK(asked < 20);
    CHECK(f.follower.state().distrusted.empty());
    CHECK(f.follower.have_count() == 4);
}

TEST_CASE("of a job that is checked only what the broker has counts, also when it is another one") {
    for (const double verify : {0.0, 0.5}) {
        CAPTURE(verify);
        Following f;
        f.step(FromStream{tile_of(f.job, 0)});
        f.job.epoch = 2;
        f.job.verify = verify;
        f.step(FromStream{f.job});
        CHECK(f.follower.have_count() == (verify > 0 ? 0 : 1));
        const auto* news = f.actions.empty() ? nullptr : std::get_if<News>(f.actions.data());
        CHECK((news && std::holds_alternative<TilesWithdrawn>(*news)) == (verify > 0));
    }
}

TEST_CASE("a follower subscribes the job, then a nonce, and asks when the nonce is echoed") {
    Follower follower(job_of_four_tiles(), Rng(1));
    std::vector<Action> actions;
    follower.start({}, actions);
    REQUIRE(actions.size() == 2);
    CHECK(std::get<Subscribe>(actions[0]).topic == protocol::job_topic(JobId{{1}}));
    const Nonce nonce = nonce_in(actions);

    actions.clear();
    follower.step({}, FromStream{protocol::Barrier{Nonce{{9}}, 1}}, actions);
    CHECK(actions.empty()); // somebody else's
    follower.step({}, FromStream{protocol::Barrier{nonce, 1}}, actions);
    REQUIRE(only<Unsubscribe>(actions));
    CHECK(only<Unsubscribe>(actions)->topic == protocol::barrier_topic(nonce));
    REQUIRE(repair_in(actions).has_value());
    CHECK(repair_in(actions)->have == Bytes(1));
}

TEST_CASE("a barrier that is not echoed within a second is raised with another nonce") {
    Follower follower(job_of_four_tiles(), Rng(1));
    std::vector<Action> actions;
    follower.start({}, actions);
    const Nonce first = nonce_in(actions);
    CHECK(follower.next_deadline() == Instant{} + 1s);

    actions.clear();
    follower.step(Instant{} + 1s, Tick{}, actions);
    REQUIRE(only<Unsubscribe>(actions));
    CHECK(only<Unsubscribe>(actions)->topic == protocol::barrier_topic(first));
    CHECK(nonce_in(actions) != first);
    CHECK(repair_in(actions).has_value()); // a watcher without a stream gets its tiles this way
}

TEST_CASE("a digest that counts more tiles than are here means that some were dropped") {
    Following f;
    f.step(FromStream{tile_of(f.job, 2)});
    CHECK(only<News>(f.actions));
    f.job.done_count = 1;
    f.step(FromStream{f.job});
    CHECK_FALSE(repair_in(f.actions).has_value());
    f.job.done_count = 3;
    f.step(FromStream{f.job});
    REQUIRE(repair_in(f.actions).has_value());
    CHECK(repair_in(f.actions)->have == Bytes{std::byte{0b0100}});
}

TEST_CASE("tiles that a broker has lost with its restart do not make up for others") {
    Following f;
    f.step(FromStream{tile_of(f.job, 0)});
    f.job.epoch = 2;
    f.job.done_count = 1; // another one
    f.job.phase = protocol::JobPhase::cancelled;
    f.step(FromStream{f.job});
    CHECK_FALSE(f.follower.is_complete());
    REQUIRE(repair_in(f.actions).has_value());
    f.step(FromBroker{tile_of(f.job, 3)});
    f.step(FromBroker{protocol::RepairDone{f.job, 0}});
    CHECK(f.follower.is_complete());
    CHECK(f.follower.have_count() == 2);
}

TEST_CASE("the first pass of a job whose time was up is here, whatever came of later ones") {
    protocol::JobState job = job_of_four_tiles();
    job.settings.time_limit = 5s;
    job.cell_count = static_cast<std::uint32_t>(4 * protocol::pass_count(job.settings));
    REQUIRE(job.cell_count > 8);
    Follower follower(job, Rng(1));
    std::vector<Action> actions;
    const auto step = [&](const Event& event) {
        actions.clear();
        follower.step(Instant{}, event, actions);
    };
    const auto pixels_of = [&](std::uint32_t pass, std::uint32_t cell) {
        protocol::TileDone tile = tile_of(job, cell);
        tile.tile = TileIndex{4 * pass + cell};
        tile.pass = pass;
        tile.blobs = {Blob(Bytes(job.settings.pixel_bytes()))};
        return tile;
    };
    follower.start(Instant{}, actions);
    step(FromStream{protocol::Barrier{nonce_in(actions), 1}});
    step(FromBroker{protocol::RepairDone{job, 0}});
    for (const std::uint32_t cell : {0u, 1u, 2u})
        step(FromStream{pixels_of(0, cell)});
    for (const std::uint32_t cell : {1u, 2u}) // which of the brokers only another one had
        step(FromStream{pixels_of(1, cell)});
    REQUIRE(follower.have_count() == 5);
    job.phase = protocol::JobPhase::done;
    job.done_count = 5; // the whole first pass, and one more
    step(FromStream{job});
    CHECK_FALSE(follower.is_complete());
    REQUIRE(repair_in(actions).has_value());
    step(FromBroker{pixels_of(0, 3)});
    CHECK(follower.is_complete());
}

TEST_CASE("an answer to what an earlier follower asked does not end this one") {
    Following f;
    f.job.phase = protocol::JobPhase::cancelled;
    f.job.done_count = 2;
    f.step(FromStream{f.job});
    REQUIRE(repair_in(f.actions).has_value());
    protocol::JobState other = f.job;
    SUBCASE("who had tiles that are not here") {}
    SUBCASE("of another broker") {
        other.epoch = 0;
        other.done_count = 0;
    }
    SUBCASE("before it was tried again") {
        protocol::JobState again = f.job;
        again.phase = protocol::JobPhase::running;
        again.elapsed = 5s;
        f.step(FromBroker{again});
        other.done_count = 0;
    }
    f.step(FromBroker{protocol::RepairDone{other, 0}});
    CHECK_FALSE(f.follower.is_complete());
    f.step(FromBroker{tile_of(f.job, 0)});
    f.step(FromBroker{tile_of(f.job, 3)});
    f.job.elapsed = 9s;
    f.step(FromStream{f.job}); // it is over in the end
    f.step(FromBroker{protocol::RepairDone{f.job, 0}});
    CHECK(f.follower.is_complete());
}

TEST_CASE("that there was no more of what was cancelled is no end of what is done by now") {
    Following f;
    f.now = f.now + 2s;
    f.step(Tick{});
    REQUIRE(repair_in(f.actions).has_value());
    protocol::JobState cancelled = f.job;
    cancelled.phase = protocol::JobPhase::cancelled;
    cancelled.revision = {2, {}};
    f.job.phase = protocol::JobPhase::done; // as another broker had come to it before it heard
    f.job.revision = {3, {}};
    f.job.done_count = 4;
    f.step(FromStream{f.job});
    f.step(FromBroker{protocol::RepairDone{cancelled, 0}});
    CHECK_FALSE(f.follower.is_complete());
    f.now = f.now + 1s;
    f.step(Tick{});
    CHECK(repair_in(f.actions).has_value());
    for (std::uint32_t i = 0; i < 4; ++i)
        f.step(FromBroker{tile_of(f.job, i)});
    CHECK(f.follower.is_complete());
}

TEST_CASE("tiles that a broker has and cannot send are not waited for for ever") {
    Following f;
    f.job.phase = protocol::JobPhase::cancelled;
    f.job.done_count = 2;
    f.step(FromStream{f.job});
    int asked = 0;
    for (; asked < 100 && !f.follower.is_complete(); ++asked) {
        f.now = f.now + 1s;
        f.step(Tick{});
        f.step(FromBroker{protocol::RepairDone{f.job, 0}});
    }
    CHECK(asked > 4);
    CHECK(asked < 20);
}

TEST_CASE("a state by the session is no digest: its tiles may still be on their way") {
    Following f;
    f.job.done_count = 3;
    f.step(FromBroker{f.job});
    CHECK_FALSE(repair_in(f.actions).has_value());
}

TEST_CASE("two seconds of silence are a reason to ask") {
    Following f;
    CHECK(f.follower.next_deadline() == Instant{} + 2s);
    f.now = Instant{} + 1s;
    f.step(FromStream{f.job});
    CHECK(f.follower.next_deadline() == Instant{} + 3s);
    f.now = Instant{} + 3s;
    f.step(Tick{});
    CHECK(repair_in(f.actions).has_value());
    CHECK(f.follower.next_deadline() == Instant{} + 5s); // and to ask again
    f.now = Instant{} + 5s;
    f.step(Tick{});
    CHECK(repair_in(f.actions).has_value());
}

TEST_CASE("what a repair left over is asked for at once; not in a circle when nothing comes") {
    Following f;
    f.job.done_count = 3;
    f.step(FromStream{f.job});
    f.step(FromBroker{tile_of(f.job, 0)});
    f.step(FromBroker{protocol::RepairDone{f.job, 2}});
    REQUIRE(repair_in(f.actions).has_value());
    f.step(FromBroker{protocol::RepairDone{f.job, 2}}); // and not a tile came
    CHECK_FALSE(repair_in(f.actions).has_value());
    CHECK(f.follower.next_deadline() > f.now);
    CHECK(f.follower.next_deadline() < f.now + 1s);
}

TEST_CASE("a tile is delivered once, and rubbish never") {
    Following f;
    const auto tile = tile_of(f.job, 1);
    f.step(FromStream{tile});
    CHECK(only<News>(f.actions));
    for (const Event& again : {Event(FromStream{tile}), Event(FromBroker{tile})}) {
        f.step(again);
        CHECK_FALSE(only<News>(f.actions));
    }
    CHECK(f.follower.counts().duplicates == 2);

    std::vector<protocol::TileDone> rubbish(8, tile_of(f.job, 0));
    rubbish[0].tile = TileIndex{4};
    rubbish[1].tile = TileIndex{UINT32_MAX};
    rubbish[2].rect = {3, 0, 2, 1}; // beyond the right edge, with pixels to match
    rubbish[2].blobs = {Blob(Bytes(24))};
    rubbish[3].rect = {0, 0, UINT32_MAX, UINT32_MAX};
    rubbish[4].rect.height = 0;
    rubbish[4].blobs = {};
    rubbish[5].blobs = {Blob(Bytes(12)), Blob(Bytes(1))};
    rubbish[6].blobs = {Blob(Bytes(11))};
    rubbish[7].job = JobId{{2}};
    for (const auto& bad : rubbish) {
        f.step(FromStream{bad});
        CHECK(f.actions.empty());
    }
    CHECK(f.follower.counts().rubbish == rubbish.size());
    CHECK(f.follower.have_count() == 1);
    f.step(FromStream{tile_of(f.job, 0)}); // the true one is still welcome
    CHECK(f.follower.have_count() == 2);
}

TEST_CASE("a tile has 5 floats a pixel where the job tells of errors, and 3 where it does not") {
    for (const bool adaptive : {false, true}) {
        auto job = job_of_four_tiles();
        job.settings.error = adaptive ? 1 : 0;
        Follower follower(job, Rng(1));
        std::vector<Action> actions;
        follower.start({}, actions);
        auto tile = tile_of(job, 0);
        for (const std::size_t bytes : {adaptive ? 12u : 20u, 16u, 24u, 40u}) {
            tile.blobs = {Blob(Bytes(bytes))};
            follower.step({}, FromStream{tile}, actions);
        }
        CHECK(follower.counts().rubbish == 4);
        CHECK(follower.have_count() == 0);
        tile.blobs = {Blob(Bytes(11)), Blob(Bytes(adaptive ? 9 : 1))};
        actions.clear();
        follower.step({}, FromStream{tile}, actions);
        CHECK(follower.have_count() == 1);
        CHECK(only<News>(actions));
    }
}

TEST_CASE("a state that contradicts the job is not believed") {
    Following f;
    std::vector<protocol::JobState> wrong(7, f.job);
    for (protocol::JobState& state : wrong) {
        state.epoch = 9; // newer than anything
        state.phase = protocol::JobPhase::cancelled;
    }
    wrong[0].job = JobId{{2}};
    wrong[1].cell_count = 5;
    wrong[2].cell_count = 0;
    wrong[3].settings.depth += 1;
    wrong[4].done_count = 5;
    wrong[5].cell_count = UINT32_MAX;
    wrong[6].settings.error = 1; // its tiles would be larger
    for (const auto& state : wrong) {
        f.step(FromStream{state});
        f.step(FromBroker{state});
        f.step(FromBroker{protocol::RepairDone{state, 0}});
        CHECK(f.actions.empty());
    }
    CHECK(f.follower.counts().rubbish == 3 * wrong.size());
    CHECK(f.follower.state() == f.job);
    CHECK_FALSE(f.follower.is_complete());
}

TEST_CASE("a job that is not cut yet is followed once it is") {
    auto job = job_of_four_tiles();
    job.phase = protocol::JobPhase::waiting_for_scene;
    job.cell_side = job.cell_count = 0;
    Follower follower(job, Rng(1));
    std::vector<Action> actions;
    follower.start({}, actions);
    follower.step({}, FromStream{tile_of(job, 0)}, actions);
    CHECK(follower.have_count() == 0);
    job = job_of_four_tiles();
    follower.step({}, FromStream{job}, actions);
    follower.step({}, FromStream{tile_of(job, 3)}, actions);
    CHECK(follower.have().test(3));
}

TEST_CASE("a finished job needs no barrier: all of it can be asked for") {
    auto job = job_of_four_tiles();
    job.phase = protocol::JobPhase::done;
    job.done_count = 4;
    Follower follower(job, Rng(1));
    std::vector<Action> actions;
    follower.start({}, actions);
    CHECK(actions.size() == 1);
    CHECK(repair_in(actions).has_value());
    for (std::uint32_t tile = 0; tile < 4; ++tile) {
        CHECK_FALSE(follower.is_complete());
        follower.step({}, FromBroker{tile_of(job, tile)}, actions);
    }
    CHECK(follower.is_complete());
    CHECK(follower.next_deadline() == Instant::never());
}

TEST_CASE("a watcher that is there from the start sees every tile once without a fault") {
    FakeFarm farm(existing(), {}, 1);
    JobWatching watching(watch_request(), Rng(1));
    CHECK(farm.run(watching, 60s));
    CHECK(farm.outcome == Outcome{});
    check_delivered(farm, farm.cell_count());
    CHECK(farm.repairs == 1); // the one after the barrier
}

TEST_CASE("a watcher joins at any time, whatever the stream drops, and sees every tile once") {
    for_each_seed(400, [](Rng& rng) {
        Faults faults{.stream_drop = rng.unit() * 0.9,
                      .stream_repeat = rng.unit() * 0.5,
                      .session_drop = rng.below(3) == 0 ? rng.unit() * 0.4 : 0,
                      .rubbish = rng.below(2) == 0 ? 0 : 0.3,
                      .delay_max = std::chrono::milliseconds(1 + rng.below(300)),
                      .stream_delay_max = std::chrono::milliseconds(1 + rng.below(800)),
                      .heal_after = std::chrono::seconds(rng.below(8))};
        for (std::uint64_t i = rng.below(3); i > 0; --i)
            faults.forgets_sessions.push_back(std::chrono::milliseconds(rng.below(6000)));
        for (std::uint64_t i = rng.below(3); i > 0; --i) {
            const auto from = std::chrono::milliseconds(rng.below(6000));
            faults.partitions.emplace_back(from, from + std::chrono::milliseconds(rng.below(5000)));
        }
        FakeJob job = existing(static_cast<std::uint32_t>(rng.below(81)));
        job.repair_tiles_max = static_cast<std::uint32_t>(1 + rng.below(40));
        FakeFarm farm(job, faults, rng.next());
        JobWatching watching(watch_request(), Rng(rng.next()));
        REQUIRE(farm.run(watching, 120s));
        CHECK(farm.outcome == Outcome{});
        check_delivered(farm, farm.cell_count());
        REQUIRE(watching.follower());
        for (std::uint32_t tile = 0; tile < farm.cell_count(); ++tile)
            CHECK(watching.follower()->have().test(tile));
    });
}

TEST_CASE("a job that was cancelled and is tried again is followed on, and late words are not") {
    protocol::JobState job = job_of_four_tiles();
    Follower follower(job, Rng(1));
    std::vector<Action> actions;
    follower.start(Instant{}, actions);
    const auto hear = [&](protocol::JobPhase phase, std::uint32_t done, Duration elapsed) {
        job.phase = phase;
        job.done_count = done;
        job.elapsed = elapsed;
        follower.step(Instant{}, FromStream{job}, actions);
        return follower.state().phase;
    };
    using enum protocol::JobPhase;
    CHECK(hear(running, 1, 4s) == running);
    CHECK(hear(cancelled, 2, 5s) == cancelled); // two tiles are missing here
    CHECK(hear(running, 2, 4500ms) == cancelled);
    CHECK(hear(running, 2, 6s) == running);
    CHECK(hear(cancelled, 2, 5s) == running);
    CHECK(hear(done, 4, 7s) == done);
    CHECK(hear(running, 4, 8s) == done);
}

TEST_CASE("of brokers that stand for each other the one that has heard most of a job is heeded") {
    protocol::JobState job = job_of_four_tiles();
    Follower follower(job, Rng(1));
    std::vector<Action> actions;
    follower.start(Instant{}, actions);
    const auto hear = [&](protocol::JobPhase phase, std::uint64_t revision, Duration elapsed) {
        job.phase = phase;
        job.done_count = 2; // of which none are here
        job.revision.counter = revision;
        job.elapsed = elapsed;
        follower.step(Instant{}, FromStream{job}, actions);
        return follower.state().phase;
    };
    using enum protocol::JobPhase;
    CHECK(hear(running, 1, 14s) == running); // one that was cut off has it go on and on
    CHECK(hear(cancelled, 2, 6s) == cancelled);
    CHECK(hear(running, 1, 15s) == cancelled);
    CHECK(hear(running, 3, 6s) == running);
    CHECK(hear(cancelled, 2, 6s) == running);
    CHECK(hear(cancelled, 4, 5s) == cancelled);
    CHECK(hear(running, 3, 20s) == cancelled);
}

TEST_CASE("a broker that is behind is not asked again and again at once") {
    Following f;
    f.job.revision.counter = 2;
    f.job.phase = protocol::JobPhase::done;
    f.job.done_count = 4;
    f.step(FromStream{f.job});
    protocol::JobState behind = f.job;
    behind.revision = {};
    behind.phase = protocol::JobPhase::running;
    behind.done_count = 0;
    int asked = 0;
    for (int answer = 0; answer < 100; ++answer) {
        f.now = f.now + 1ms;
        f.step(FromBroker{protocol::RepairDone{behind, 0}});
        f.step(Tick{});
        asked += repair_in(f.actions).has_value();
        f.actions.clear();
    }
    CHECK(asked <= 1);
    CHECK(f.follower.next_deadline() <= f.now + 2s);
    CHECK_FALSE(f.follower.is_complete());
}

TEST_CASE("a job that was acknowledged does not wait for its scene again") {
    protocol::JobState job = job_of_four_tiles();
    job.phase = protocol::JobPhase::queued;
    Follower follower(job, Rng(1));
    std::vector<Action> actions;
    follower.start(Instant{}, actions);
    job.phase = protocol::JobPhase::waiting_for_scene; // said before, and once more
    follower.step(Instant{}, FromBroker{job}, actions);
    CHECK(follower.state().phase == protocol::JobPhase::queued);
}

TEST_CASE("of a tile that is here in part only the rest is told, with its own pixels") {
    protocol::JobState job = job_of_four_tiles();
    job.settings.size = {4, 3};
    job.settings.crop = {0, 0, 4, 3};
    job.cell_count = 12;
    Follower follower(job, Rng(1));
    const auto tile_at = [&](PixelRect rect) {
        protocol::TileDone done;
        done.job = job.job;
        done.tile = TileIndex{rect.y * 4 + rect.x};
        done.rect = rect;
        done.rays.camera = rect.pixel_count();
        Bytes pixels;
        for (std::uint32_t y = rect.y; y < rect.y + rect.height; ++y)
            for (std::uint32_t x = rect.x; x < rect.x + rect.width; ++x)
                pixels.insert(pixels.end(), 12, static_cast<std::byte>(10 * y + x));
        done.blobs = {Blob(std::move(pixels))};
        return done;
    };
    std::vector<Action> actions;
    follower.start(Instant{}, actions);
    std::vector<int> seen(12);
    const auto hear = [&](PixelRect heard) {
        actions.clear();
        follower.step(Instant{}, FromStream{tile_at(heard)}, actions);
        for (const Action& action : actions) {
            const auto* news = std::get_if<News>(&action);
            const auto* arrived = news ? std::get_if<TileArrived>(news) : nullptr;
            if (!arrived)
                continue;
            const protocol::TileDone& tile = arrived->tile;
            CHECK((tile.blobs.at(0) == tile_at(tile.rect).blobs[0]));
            CHECK(tile.tile == tile_at(tile.rect).tile);
            CHECK(tile.rays.camera == tile.rect.pixel_count());
            for (std::uint32_t y = tile.rect.y; y < tile.rect.y + tile.rect.height; ++y)
                for (std::uint32_t x = tile.rect.x; x < tile.rect.x + tile.rect.width; ++x)
                    ++seen[y * 4 + x];
        }
    };
    hear({1, 1, 2, 1});
    hear({0, 0, 4, 3});
    CHECK(seen == std::vector<int>(12, 1));
    hear({0, 0, 2, 2}); // nothing new
    CHECK(seen == std::vector<int>(12, 1));
    CHECK(follower.have_count() == 12);
    CHECK(follower.counts().duplicates == 1);
}

TEST_CASE("a job that ends badly ends the watcher as well, with every tile that was done") {
    for_each_seed(200, [](Rng& rng) {
        const bool failed = rng.below(2) == 0;
        FakeJob job = existing();
        job.ending = failed ? protocol::JobPhase::failed : protocol::JobPhase::cancelled;
        job.ends_after = static_cast<std::uint32_t>(1 + rng.below(79));
        Faults faults{.stream_drop = rng.unit() * 0.9,
                      .rubbish = rng.below(2) == 0 ? 0 : 0.2,
                      .stream_delay_max = std::chrono::milliseconds(1 + rng.below(500))};
        FakeFarm farm(job, faults, rng.next());
        JobWatching watching(watch_request(), Rng(rng.next()));
        REQUIRE(farm.run(watching, 120s));
        CHECK(farm.outcome->code == (failed ? ExitCode::job_failed : ExitCode::cancelled));
        CHECK(farm.outcome->reason == "as planned");
        check_delivered(farm, job.ends_after);
    });
}

TEST_CASE("whoever cannot reach the stream gets every tile all the same") {
    FakeFarm farm(existing(), {.no_stream = true}, 1);
    JobWatching watching(watch_request(), Rng(1));
    REQUIRE(farm.run(watching, 60s));
    check_delivered(farm, farm.cell_count());
}

TEST_CASE("a watcher waits for a job that a restarted broker has yet to be told of again") {
    Faults faults;
    faults.forgets_all = {1s};
    faults.submitted_again = {4s};
    FakeFarm farm(existing(), faults, 1);
    JobWatching watching(watch_request(), Rng(1));
    REQUIRE(farm.run(watching, 60s));
    CHECK(farm.outcome->code == ExitCode::done);
    check_delivered(farm, farm.cell_count());
}

TEST_CASE("a job that is found but later forgotten ends the watcher with no_such_job") {
    Faults faults;
    faults.forgets_all = {1s};
    FakeFarm farm(existing(), faults, 1);
    JobWatching watching(watch_request(), Rng(1));
    REQUIRE(farm.run(watching, 60s));
    CHECK(farm.outcome->code == ExitCode::no_such_job);
}

TEST_CASE("states are shown in order, although session and stream overtake each other") {
    for_each_seed(50, [](Rng& rng) {
        FakeFarm farm(existing(), {.stream_drop = 0.3, .stream_delay_max = 700ms}, rng.next());
        JobWatching watching(watch_request(), Rng(rng.next()));
        REQUIRE(farm.run(watching, 60s));
        CHECK(std::ranges::is_sorted(farm.states, {}, &protocol::JobState::done_count));
        CHECK(farm.states.back().phase == protocol::JobPhase::done);
    });
}
