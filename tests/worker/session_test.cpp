#include "tests/worker/session_driver.hpp"
#include "worker/session.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <iterator>

using namespace fraja;
using namespace fraja::worker;
using namespace fraja::protocol;
using namespace std::chrono_literals;

namespace {

/// Connected, with a compiled scene of one chunk.
struct Ready : SessionDriver {
    TestScene scene{100};
    Ready() {
        connect();
        (void)receive(order(scene, 0));
        (void)receive(scene.chunk(0));
        const auto actions = step(SceneCompiled{scene.hash});
        (void)step(TileFinished{of_type<StartTile>(actions).at(0).ticket, {}, {}, {}});
    }
};

std::string failure(const std::vector<Action>& actions) {
    const auto failed = sent<TileFailed>(actions);
    if (failed.size() != 1)
        return std::to_string(failed.size()) + " failures";
    const char* names[] = {"scene: ", "machine: ", "cancelled: "};
    return names[static_cast<int>(failed[0].code)] + failed[0].reason;
}

} // namespace

TEST_CASE("session greets at once, with all it has to say, and grants two tiles a thread") {
    SessionDriver driver;
    const auto hellos = sent<WorkerHello>(driver.step(Tick{}));
    REQUIRE(hellos.size() == 1);
    CHECK(hellos[0].worker == test_identity().worker);
    CHECK(hellos[0].worker_name == "tester");
    CHECK(hellos[0].threads == 2);
    CHECK(hellos[0].credit == 4);
    CHECK(hellos[0].tags == std::vector<std::string>{"fast", "os=x"});
    CHECK(hellos[0].incarnation == 1);
}

TEST_CASE("credit_for stays within the wire's limit") {
    CHECK(credit_for(1, {}) == 2);
    CHECK(credit_for(threads_max, {}) <= credit_max);
    Limits greedy;
    greedy.prefetch_per_thread = UINT32_MAX;
    CHECK(credit_for(UINT32_MAX, greedy) == credit_max);
}

TEST_CASE("session greets an absent broker ever more rarely, and says so once") {
    SessionDriver driver;
    (void)driver.step(Tick{});
    std::size_t warnings = 0;
    std::uint64_t incarnation = 1;
    for (int i = 0; i < 50; ++i) {
        const Duration pause = driver.session.next_deadline() - driver.now;
        CHECK(pause >= 500ms);
        CHECK(pause <= 5s);
        if (i > 5)
            CHECK(pause >= 2500ms);
        const auto actions = driver.pass(pause);
        const auto hellos = sent<WorkerHello>(actions);
        REQUIRE(hellos.size() == 1);
        CHECK(hellos[0].incarnation == ++incarnation);
        warnings += of_type<Log>(actions).size();
    }
    CHECK(warnings == 1);
}

TEST_CASE("two workers do not greet an absent broker in step") {
    Identity other = test_identity();
    other.worker.bytes[9] = 1;
    SessionDriver a, b(other);
    (void)a.step(Tick{});
    (void)b.step(Tick{});
    CHECK(a.session.next_deadline() != b.session.next_deadline());
}

TEST_CASE("session asks for a scene once, though many tiles wait, and starts them all with it") {
    SessionDriver driver;
    driver.connect();
    const TestScene scene(chunk_bytes + 5);
    auto actions = driver.receive(order(scene, 0));
    REQUIRE(sent<NeedChunk>(actions) == std::vector{NeedChunk{scene.hash, 0}});
    CHECK(sent<NeedChunk>(driver.receive(order(scene, 1))).empty());
    actions = driver.receive(scene.chunk(0));
    CHECK(sent<NeedChunk>(actions) == std::vector{NeedChunk{scene.hash, chunk_bytes}});
    CHECK(driver.receive(order(scene, 2)).empty());
    actions = driver.receive(scene.chunk(chunk_bytes));
    const auto compiles = of_type<CompileScene>(actions);
    REQUIRE(compiles.size() == 1);
    CHECK(compiles[0].scene == scene.hash);
    CHECK(compiles[0].chunks.size() == 2);
    CHECK(driver.receive(order(scene, 3)).empty());
    CHECK(of_type<StartTile>(driver.step(SceneCompiled{scene.hash})).size() == 4);
}

TEST_CASE("a scene is compiled for the kernel of its first tile; each tile names its own") {
    SessionDriver driver;
    driver.connect();
    const TestScene scene(3);
    RenderTile reference = order(scene, 8);
    reference.settings.kernel = KernelChoice::reference;
    (void)driver.receive(order(TestScene(3, 'z'), 7));
    (void)driver.receive(reference);
    (void)driver.receive(order(scene, 9));
    const auto compiles = of_type<CompileScene>(driver.receive(scene.chunk(0)));
    REQUIRE(compiles.size() == 1);
    CHECK(compiles[0].kernel == KernelChoice::reference);
    const auto started = of_type<StartTile>(driver.step(SceneCompiled{scene.hash}));
    REQUIRE(started.size() == 2);
    CHECK(started[0].settings.kernel == KernelChoice::reference);
    CHECK(started[1].settings.kernel == KernelChoice::fast);
}

TEST_CASE("session answers a rendered tile, once") {
    Ready driver;
    const auto started = of_type<StartTile>(driver.receive(order(driver.scene, 5, 7)));
    REQUIRE(started.size() == 1);
    CHECK(started[0].rect == PixelRect{0, 0, 16, 16});
    const TileFinished finished{
        started[0].ticket, Rays{1, 2, 3, 4, 5, 6, 7, 8, 9}, 7ms, {Blob(Bytes(12))}};
    const auto answers = sent<TileRendered>(driver.step(finished));
    REQUIRE(answers.size() == 1);
    CHECK(answers[0].tile == TileIndex{5});
    CHECK(answers[0].attempt == AttemptNumber{7});
    CHECK(answers[0].rays == finished.rays);
    CHECK(answers[0].elapsed == 7ms);
    CHECK(answers[0].blobs.size() == 1);
    CHECK(driver.step(finished).empty());
}

TEST_CASE("session says whose fault a failure is") {
    struct Row {
        ErrorCode error;
        const char* want;
    };
    for (const Row& row :
         {Row{ErrorCode::unresolved_overlap, "scene: why"},
          Row{ErrorCode::invalid_scene, "scene: why"}, Row{ErrorCode::limit_exceeded, "scene: why"},
          Row{ErrorCode::cancelled, "cancelled: why"}, Row{ErrorCode::io, "machine: why"},
          Row{ErrorCode::malformed_frame, "machine: why"}}) {
        Ready driver;
        const auto started = of_type<StartTile>(driver.receive(order(driver.scene, 5)));
        CHECK(failure(driver.step(TileBroken{started.at(0).ticket, {row.error, "why"}})) ==
              row.want);
    }
}

TEST_CASE("a scene that cannot be drawn fails its tiles, also those that come later") {
    SessionDriver driver;
    driver.connect();
    const TestScene scene(10);
    (void)driver.receive(order(scene, 0));
    (void)driver.receive(order(scene, 1));
    (void)driver.receive(scene.chunk(0));
    const auto actions =
        driver.step(SceneFailed{scene.hash, {ErrorCode::invalid_scene, "scene:1:1: no"}});
    CHECK(sent<TileFailed>(actions).size() == 2);
    CHECK(failure(driver.receive(order(scene, 2))) == "scene: scene:1:1: no");
}

TEST_CASE("a scene that failed for this machine's sake is fetched anew") {
    SessionDriver driver;
    driver.connect();
    const TestScene scene(10);
    (void)driver.receive(order(scene, 0));
    (void)driver.receive(scene.chunk(0));
    CHECK(failure(driver.step(SceneFailed{scene.hash, {ErrorCode::malformed_frame, "hash"}})) ==
          "machine: hash");
    CHECK(sent<NeedChunk>(driver.receive(order(scene, 1))).size() == 1);
}

TEST_CASE("session asks again for a chunk that does not come, and gives up in the end") {
    SessionDriver driver;
    driver.connect();
    const TestScene scene(10);
    (void)driver.receive(order(scene, 0));
    CHECK(sent<NeedChunk>(driver.pass_with_beats(2500ms)).empty());
    CHECK(sent<NeedChunk>(driver.pass_with_beats(1s)).size() == 1);
    const auto actions = driver.pass_with_beats(20s);
    CHECK(sent<NeedChunk>(actions).size() == 3);
    CHECK(failure(actions) == "machine: the broker does not send the scene, asked 5 times");
}

TEST_CASE("chunks that do not fit are ignored, or fail what waits for them") {
    const TestScene scene(chunk_bytes + 5), other(10, 'o');
    SUBCASE("ignored: of another scene, or not the one that was asked for") {
        SessionDriver driver;
        driver.connect();
        (void)driver.receive(order(scene, 0));
        CHECK(of_type<Send>(driver.receive(other.chunk(0))).empty());
        CHECK(of_type<Send>(driver.receive(scene.chunk(chunk_bytes))).empty());
        (void)driver.receive(scene.chunk(0));
        CHECK(of_type<Send>(driver.receive(scene.chunk(0))).empty());
        CHECK(of_type<CompileScene>(driver.receive(scene.chunk(chunk_bytes))).size() == 1);
    }
    SUBCASE("fail: of a wrong size, or of a whole of a wrong size") {
        for (const bool total : {false, true}) {
            SessionDriver driver;
            driver.connect();
            (void)driver.receive(order(scene, 0));
            Chunk chunk = scene.chunk(0);
            if (total)
                ++chunk.total_bytes;
            else
                chunk.blobs = {Blob(Bytes(chunk_bytes - 1))};
            CHECK(failure(driver.receive(chunk)) ==
                  "machine: the scene came in chunks of a wrong size");
        }
    }
    SUBCASE("fail: the broker has none") {
        SessionDriver driver;
        driver.connect();
        (void)driver.receive(order(scene, 0));
        const Refused refused{RefusalCode::invalid, {}, "no such chunk"};
        for (int i = 0; i < 4; ++i) // it may have come twice, and be about another scene
            CHECK(sent<NeedChunk>(driver.receive(refused)).size() == 1);
        CHECK(failure(driver.receive(refused)) ==
              "machine: the broker does not give the scene: no such chunk");
    }
}

TEST_CASE("session refuses tiles that no sound broker sends") {
    const TestScene scene(10);
    struct Row {
        const char* what;
        void (*spoil)(RenderTile&);
    };
    for (const Row& row :
         {Row{"empty", [](RenderTile& t) { t.rect.width = 0; }},
          Row{"beyond the crop", [](RenderTile& t) { t.rect.x = 250; }},
          Row{"far beyond", [](RenderTile& t) { t.rect.x = UINT32_MAX; }},
          Row{"left of the crop",
              [](RenderTile& t) {
                  t.settings.crop = {1, 1, 100, 100};
              }},
          Row{"too large",
              [](RenderTile& t) {
                  t.settings.size = {4000, 4000};
                  t.settings.crop = {0, 0, 4000, 4000};
                  t.rect = {0, 0, 1025, 1};
              }},
          Row{"a probe of too many squares",
              [](RenderTile& t) {
                  t.settings.size = {4097, 1};
                  t.settings.crop = t.rect = {0, 0, 4097, 1};
                  t.probe_side = 1;
              }},
          Row{"a probe of none",
              [](RenderTile& t) {
                  t.rect.width = 0;
                  t.probe_side = 1;
              }},
          Row{"depth", [](RenderTile& t) { t.settings.depth = depth_max + 1; }},
          Row{"aa", [](RenderTile& t) { t.settings.aa = UINT32_MAX; }},
          Row{"no pixels",
              [](RenderTile& t) {
                  t.settings.size = {0, 0};
              }},
          Row{"scene too large", [](RenderTile& t) { t.scene_bytes = UINT64_MAX; }}}) {
        CAPTURE(row.what);
        SessionDriver driver;
        driver.connect();
        RenderTile tile = order(scene, 0);
        row.spoil(tile);
        CHECK(failure(driver.receive(tile)).starts_with("machine: "));
    }
}

TEST_CASE("session takes a probe of probe_squares_max squares") {
    const TestScene scene(10);
    SessionDriver driver;
    driver.connect();
    RenderTile probe = order(scene, 0);
    probe.settings.size = {probe_squares_max, 1};
    probe.settings.crop = probe.rect = {0, 0, probe_squares_max, 1};
    probe.probe_side = 1;
    CHECK(failure(driver.receive(probe)) == "0 failures");
}

TEST_CASE("session takes no tile beyond its credit, and none twice") {
    SessionDriver driver;
    driver.connect();
    const TestScene scene(10);
    for (std::uint32_t i = 0; i < 4; ++i)
        CHECK(sent<TileFailed>(driver.receive(order(scene, i))).empty());
    CHECK(of_type<Send>(driver.receive(order(scene, 3))).empty());
    CHECK(failure(driver.receive(order(scene, 4))).starts_with("machine: beyond"));
    CHECK(sent<WorkerBeat>(driver.pass(1s)).at(0).in_flight.size() == 4);
}

TEST_CASE("session beats once a heartbeat and tells how far its tiles are") {
    Ready driver;
    const Ticket ticket = of_type<StartTile>(driver.receive(order(driver.scene, 5))).at(0).ticket;
    (void)driver.receive(order(driver.scene, 6));
    driver.now = driver.now + 1s;
    const auto beats = sent<WorkerBeat>(driver.step(Tick{{{ticket, 1234}, {Ticket{77}, 1}}}));
    REQUIRE(beats.size() == 1);
    CHECK(beats[0].credit == 4);
    CHECK(beats[0].in_flight ==
          std::vector{TileInFlight{job_id(1), TileIndex{5}, AttemptNumber{6}, 1234},
                      TileInFlight{job_id(1), TileIndex{6}, AttemptNumber{7}, 0}});
    CHECK(sent<WorkerBeat>(driver.pass(500ms)).empty());
    CHECK(sent<WorkerBeat>(driver.pass(500ms)).size() == 1);
}

TEST_CASE("a cancelled tile is stopped and answered at once, wherever it is") {
    Ready driver;
    const TestScene other(10, 'o');
    const Ticket ticket = of_type<StartTile>(driver.receive(order(driver.scene, 5))).at(0).ticket;
    (void)driver.receive(order(other, 6));
    SUBCASE("running") {
        const auto actions = driver.receive(CancelTile{job_id(1), TileIndex{5}, AttemptNumber{6}});
        CHECK(failure(actions) == "cancelled: cancelled by the broker");
        REQUIRE(of_type<StopTile>(actions).size() == 1);
        CHECK(of_type<StopTile>(actions)[0].ticket == ticket);
        CHECK(driver.step(TileFinished{ticket, {}, {}, {}}).empty());
    }
    SUBCASE("waiting for its scene, which then is not wanted any more") {
        const auto actions = driver.receive(CancelTile{job_id(1), TileIndex{6}, AttemptNumber{7}});
        CHECK(failure(actions) == "cancelled: cancelled by the broker");
        CHECK(of_type<StopTile>(actions).empty());
        CHECK(of_type<CompileScene>(driver.receive(other.chunk(0))).empty());
    }
    SUBCASE("answered before, or of another attempt") {
        (void)driver.step(TileFinished{ticket, {}, {}, {}});
        CHECK(driver.receive(CancelTile{job_id(1), TileIndex{5}, AttemptNumber{6}}).empty());
        CHECK(driver.receive(CancelTile{job_id(1), TileIndex{6}, AttemptNumber{8}}).empty());
    }
}

TEST_CASE("a broker that does not know the worker is greeted anew, and what there was is dropped") {
    Ready driver;
    (void)driver.receive(order(driver.scene, 5));
    driver.now = driver.now + 5s;
    (void)driver.receive(Beat{});
    driver.now = driver.now + 1s;
    const auto actions = driver.receive(Refused{RefusalCode::unknown_peer, {}, "hello?"});
    CHECK(of_type<StopTile>(actions).size() == 1);
    REQUIRE(sent<WorkerHello>(actions).size() == 1);
    CHECK(sent<WorkerHello>(actions)[0].incarnation == 2);
    CHECK(of_type<Send>(actions).size() == 1);
    SUBCASE("further refusals of what was sent before change nothing") {
        CHECK(driver.receive(Refused{RefusalCode::unknown_peer, {}, "hello?"}).empty());
    }
    SUBCASE("the scene is still here when it is wanted again") {
        (void)driver.receive(welcome());
        CHECK(of_type<StartTile>(driver.receive(order(driver.scene, 5, 7))).size() == 1);
    }
}

TEST_CASE("a broker that welcomes and forgets by turns is not greeted faster than an absent one") {
    SessionDriver driver;
    driver.connect();
    CHECK(sent<WorkerHello>(driver.receive(Refused{RefusalCode::unknown_peer, {}, ""})).empty());
    CHECK(driver.session.next_deadline() - driver.now == 1s);
    CHECK(sent<WorkerHello>(driver.pass(1s)).size() == 1);
}

TEST_CASE("a silent broker is lost, and greeted until it answers") {
    Ready driver;
    (void)driver.receive(order(driver.scene, 5));
    CHECK(sent<WorkerHello>(driver.pass(2999ms)).empty());
    auto actions = driver.pass(1ms);
    CHECK(of_type<StopTile>(actions).size() == 1);
    CHECK(sent<WorkerHello>(actions).size() == 1);
    CHECK(of_type<Log>(actions).size() == 1);
    actions = driver.receive(welcome());
    CHECK(of_type<Log>(actions).size() == 1);
    CHECK(sent<WorkerBeat>(driver.pass(1s)).at(0).in_flight.empty());
}

TEST_CASE("a Welcome that comes twice drops nothing in silence: the broker is greeted anew") {
    Ready driver;
    (void)driver.receive(order(driver.scene, 5));
    auto actions = driver.receive(welcome());
    CHECK(of_type<StopTile>(actions).size() == 1);
    CHECK(of_type<Send>(actions).empty());
    CHECK(of_type<Send>(driver.receive(welcome())).empty()); // nor by a third one
    CHECK(of_type<Send>(driver.receive(order(driver.scene, 6))).empty());
    actions = driver.pass(1s);
    REQUIRE(sent<WorkerHello>(actions).size() == 1);
    CHECK(sent<WorkerHello>(actions)[0].incarnation == 2);
    CHECK(of_type<Send>(actions).size() == 1);
    SUBCASE("nor does it bring back one that leaves") {
        (void)driver.receive(welcome());
        const Ticket ticket =
            of_type<StartTile>(driver.receive(order(driver.scene, 7))).at(0).ticket;
        (void)driver.step(Drain{});
        CHECK(driver.receive(welcome()).empty());
        CHECK(sent<TileRendered>(driver.step(TileFinished{ticket, {}, {}, {}})).size() == 1);
    }
}

TEST_CASE("an order that comes twice is answered once, and counts once") {
    Ready driver;
    const RenderTile first = order(driver.scene, 5), second = order(driver.scene, 6);
    const Ticket ticket = of_type<StartTile>(driver.receive(first)).at(0).ticket;
    SUBCASE("while it is being rendered") {
        CHECK(of_type<StartTile>(driver.receive(first)).empty());
        CHECK(sent<TileRendered>(driver.step(TileFinished{ticket, {}, {}, {}})).size() == 1);
        CHECK(sent<WorkerBeat>(driver.pass(1s)).at(0).tiles_received == 2);
    }
    SUBCASE("when it has been answered, and after another one") {
        (void)driver.step(TileFinished{ticket, {}, {}, {}});
        CHECK(of_type<StartTile>(driver.receive(second)).size() == 1);
        CHECK(of_type<StartTile>(driver.receive(first)).empty());
        const auto beats = sent<WorkerBeat>(driver.pass(1s));
        CHECK(beats.at(0).tiles_received == 3);
        CHECK(beats.at(0).in_flight.size() == 1);
    }
    SUBCASE("when its session is over, unless another broker counts anew") {
        (void)driver.receive(Refused{RefusalCode::unknown_peer, {}, "hello?"});
        (void)driver.receive(second); // too late, but it has come
        (void)driver.pass(1s);
        (void)driver.receive(welcome());
        CHECK(of_type<StartTile>(driver.receive(first)).empty());
        CHECK(of_type<StartTile>(driver.receive(second)).empty());
        (void)driver.receive(Refused{RefusalCode::unknown_peer, {}, "hello?"});
        (void)driver.pass(1s);
        Welcome other = welcome();
        other.broker.bytes[0] = 1;
        (void)driver.receive(other);
        CHECK(of_type<StartTile>(driver.receive(first)).size() == 1);
    }
}

TEST_CASE("what is at hand is not taken once more, wherever a broker's count leaps") {
    Ready driver;
    const Ticket ticket =
        of_type<StartTile>(driver.receive(order(driver.scene, 4, 256))).at(0).ticket;
    (void)driver.receive(order(driver.scene, 5, 3'419'130'827));
    CHECK(of_type<StartTile>(driver.receive(order(driver.scene, 4, 256))).empty());
    CHECK(sent<TileRendered>(driver.step(TileFinished{ticket, {}, {}, {}})).size() == 1);
    CHECK(sent<WorkerBeat>(driver.pass(1s)).at(0).in_flight.size() == 1);
}

TEST_CASE("a broker's count of RenderTiles may come round") {
    Ready driver;
    CHECK(of_type<StartTile>(driver.receive(order(driver.scene, 4, 1u << 31))).size() == 1);
    CHECK(of_type<StartTile>(driver.receive(order(driver.scene, 5, UINT32_MAX))).size() == 1);
    CHECK(of_type<StartTile>(driver.receive(order(driver.scene, 6, 3))).size() == 1);
    CHECK(of_type<StartTile>(driver.receive(order(driver.scene, 5, UINT32_MAX))).empty());
}

TEST_CASE("a Welcome to an earlier hello opens nothing, and its tiles are not taken") {
    SessionDriver driver;
    const TestScene scene(10);
    (void)driver.step(Tick{});
    CHECK(sent<WorkerHello>(driver.pass(2s)).size() == 1);
    CHECK(driver.incarnation == 2);
    Welcome late = welcome();
    late.incarnation = 1;
    CHECK(of_type<Send>(driver.receive(late)).empty());
    CHECK(of_type<Send>(driver.receive(order(scene, 1))).empty());
    (void)driver.receive(welcome());
    CHECK(sent<NeedChunk>(driver.receive(order(scene, 1, 3))).size() == 1);
    const auto beats = sent<WorkerBeat>(driver.pass(1s));
    REQUIRE(beats.size() == 1);
    CHECK(beats[0].tiles_received == 1);
    CHECK(beats[0].in_flight.size() == 1);
}

TEST_CASE("a broker of another version ends the worker") {
    SUBCASE("refused in our version") {
        SessionDriver driver;
        (void)driver.step(Tick{});
        const auto actions =
            driver.receive(Refused{RefusalCode::version_mismatch, {}, "this is version 9"});
        REQUIRE(of_type<Finished>(actions).size() == 1);
        CHECK(of_type<Finished>(actions)[0].reason == FinishReason::version_mismatch);
        CHECK(driver.session.next_deadline() == Instant::never());
    }
    SUBCASE("refused in its own") {
        SessionDriver driver;
        (void)driver.step(Tick{});
        const auto actions = driver.step(Undecodable{{ErrorCode::version_mismatch, "version 9"}});
        CHECK(of_type<Finished>(actions).size() == 1);
    }
}

namespace {

/// Of a worker that brokers call.
Identity called_identity() {
    Identity identity = test_identity();
    identity.is_called = true;
    return identity;
}

} // namespace

TEST_CASE("a caller that is gone takes its tiles with it, and the next one is greeted at once") {
    SessionDriver driver(called_identity());
    driver.connect();
    const TestScene scene(100);
    (void)driver.receive(order(scene, 1));
    (void)driver.receive(scene.chunk(0));
    REQUIRE(of_type<StartTile>(driver.step(SceneCompiled{scene.hash})).size() == 1);
    auto actions = driver.step(CallerGone{}); // within a second of the last hello
    CHECK(of_type<StopTile>(actions).size() == 1);
    CHECK(sent<TileFailed>(actions).empty());
    const auto hellos = sent<WorkerHello>(actions);
    REQUIRE(hellos.size() == 1);
    CHECK(hellos[0].incarnation == 2);
    (void)driver.receive(welcome());
    actions = driver.receive(order(scene, 1, 3, 2)); // the scene is still on the shelf
    CHECK(of_type<StartTile>(actions).size() == 1);
}

TEST_CASE("no caller ends a worker: whoever is of another version is hung up on, for good") {
    for (const bool in_words : {true, false}) {
        CAPTURE(in_words);
        SessionDriver driver(called_identity());
        (void)driver.step(Tick{});
        const auto actions =
            in_words ? driver.receive(Refused{RefusalCode::version_mismatch, {}, "version 1"})
                     : driver.step(Undecodable{{ErrorCode::version_mismatch, "version 9"}});
        CHECK(of_type<Finished>(actions).empty());
        REQUIRE(of_type<HangUp>(actions).size() == 1);
        CHECK(of_type<HangUp>(actions)[0].for_good);
        CHECK(sent<WorkerHello>(driver.step(CallerGone{})).size() == 1);
    }
    SessionDriver driver(called_identity());
    driver.connect();
    CHECK(of_type<HangUp>(driver.receive(Dismissed{"go"})).size() == 1);
    CHECK(sent<WorkerHello>(driver.step(CallerGone{})).size() == 1);
    (void)driver.receive(welcome());
    // Its owner does.
    CHECK(of_type<Finished>(driver.step(StopNow{})).empty()); // the last beat has its answer first
    CHECK(of_type<Finished>(driver.receive(Beat{})).size() == 1);
}

TEST_CASE("a caller that does not answer leaves its turn to others and comes again") {
    SessionDriver driver(called_identity());
    std::size_t hellos = sent<WorkerHello>(driver.step(Tick{})).size();
    for (;;) {
        const auto actions = driver.pass(driver.session.next_deadline() - driver.now);
        if (const auto hung_up = of_type<HangUp>(actions); !hung_up.empty()) {
            CHECK_FALSE(hung_up[0].for_good);
            break;
        }
        hellos += sent<WorkerHello>(actions).size();
        REQUIRE(hellos < 100);
    }
    CHECK(hellos == Limits{}.hellos_per_turn);
    CHECK(sent<WorkerHello>(driver.step(CallerGone{})).size() == 1);
    // One that answers keeps it, however often it forgets the worker.
    for (int i = 0; i < 20; ++i) {
        (void)driver.receive(welcome());
        (void)driver.receive(Refused{RefusalCode::unknown_peer, {}, ""});
        const auto actions = driver.pass(2s);
        CHECK(of_type<HangUp>(actions).empty());
        CHECK(sent<WorkerHello>(actions).size() == 1);
    }
}

TEST_CASE("a worker that is leaving leaves with its caller") {
    SessionDriver driver(called_identity());
    driver.connect();
    (void)driver.receive(order(TestScene(100), 1));
    CHECK(of_type<Finished>(driver.step(Drain{})).empty());
    const auto finished = of_type<Finished>(driver.step(CallerGone{}));
    REQUIRE(finished.size() == 1);
    CHECK(finished[0].reason == FinishReason::drained);
}

TEST_CASE("a hello that is refused for another reason is tried again") {
    SessionDriver driver;
    (void)driver.step(Tick{});
    CHECK(of_type<Log>(driver.receive(Refused{RefusalCode::limit_exceeded, {}, "full"})).size() ==
          1);
    CHECK(sent<WorkerHello>(driver.pass(1s)).size() == 1);
}

TEST_CASE("draining: takes nothing more, finishes, says goodbye") {
    Ready driver;
    SUBCASE("with a tile at hand") {
        const Ticket ticket =
            of_type<StartTile>(driver.receive(order(driver.scene, 5))).at(0).ticket;
        auto actions = driver.step(Drain{});
        REQUIRE(sent<WorkerBeat>(actions).size() == 1);
        CHECK(sent<WorkerBeat>(actions)[0].credit == 0);
        CHECK(of_type<Finished>(actions).empty());
        (void)driver.receive(Beat{});
        CHECK(failure(driver.receive(order(driver.scene, 6))) ==
              "cancelled: this worker is leaving");
        CHECK(sent<WorkerBeat>(driver.pass(1s)).at(0).credit == 0);
        (void)driver.receive(Beat{});
        SUBCASE("that is finished") {
            actions = driver.step(TileFinished{ticket, {}, {}, {}});
            CHECK(sent<TileRendered>(actions).size() == 1);
            CHECK(sent<Goodbye>(actions).size() == 1);
        }
        SUBCASE("that the broker does not want") {
            actions = driver.receive(CancelTile{job_id(1), TileIndex{5}, AttemptNumber{6}});
            CHECK(sent<Goodbye>(actions).size() == 1);
        }
        SUBCASE("but no broker left to give it to") {
            actions = driver.pass(3s);
            CHECK(of_type<Send>(actions).empty());
        }
        REQUIRE(of_type<Finished>(actions).size() == 1);
        CHECK(of_type<Finished>(actions)[0].reason == FinishReason::drained);
        CHECK(driver.pass(10s).empty());
    }
    SUBCASE("with nothing at hand, once the broker has heard all") {
        CHECK(sent<Goodbye>(driver.step(Drain{})).empty());
        const auto actions = driver.receive(Beat{});
        CHECK(sent<Goodbye>(actions).size() == 1);
        CHECK(of_type<Finished>(actions).size() == 1);
    }
    SUBCASE("with nothing at hand, and a broker that does not answer") {
        (void)driver.step(Drain{});
        CHECK(driver.session.next_deadline() <= driver.now + 1s);
        const auto actions = driver.pass(1s);
        CHECK(sent<Goodbye>(actions).size() == 1);
        CHECK(of_type<Finished>(actions).size() == 1);
    }
}

TEST_CASE("draining without a connection ends at once, without a word") {
    SessionDriver driver;
    (void)driver.step(Tick{});
    const auto actions = driver.step(Drain{});
    CHECK(of_type<Send>(actions).empty());
    CHECK(of_type<Finished>(actions).size() == 1);
}

TEST_CASE("stopping hands back every tile, after it has said that it takes no other") {
    for (const bool draining_before : {false, true}) {
        Ready driver;
        (void)driver.receive(order(driver.scene, 5));
        (void)driver.receive(order(TestScene(10, 'o'), 6));
        std::vector<Action> actions;
        if (draining_before)
            actions = driver.step(Drain{});
        std::ranges::move(driver.step(StopNow{}), std::back_inserter(actions));
        CHECK(of_type<StopTile>(actions).size() == 1);
        const auto sends = of_type<Send>(actions);
        REQUIRE(sends.size() == 3);
        CHECK(std::get<WorkerBeat>(sends[0].message).credit == 0);
        for (const TileFailed& failed : sent<TileFailed>(actions))
            CHECK(failed.code == FailureCode::cancelled);
        actions = driver.receive(Beat{});
        CHECK(sent<Goodbye>(actions).size() == 1);
        REQUIRE(of_type<Finished>(actions).size() == 1);
        CHECK(of_type<Finished>(actions)[0].reason == FinishReason::stopped);
    }
}

TEST_CASE("rubbish is counted and does not flood the log") {
    SessionDriver driver;
    driver.connect();
    std::size_t lines = 0;
    for (int i = 0; i < 1000; ++i) {
        lines += of_type<Log>(driver.step(Undecodable{{ErrorCode::malformed_frame, "?"}})).size();
        lines += of_type<Log>(driver.receive(SubmitJob{})).size();
    }
    CHECK(lines == 11); // 1, 2, 4 … 1024
}

TEST_CASE("reasons are cut to what a message may carry, between characters") {
    Ready driver;
    const Ticket ticket = of_type<StartTile>(driver.receive(order(driver.scene, 5))).at(0).ticket;
    std::string reason = "x";
    while (reason.size() < 2 * string_bytes_max)
        reason += "\xc3\xa4";
    const auto failed =
        sent<TileFailed>(driver.step(TileBroken{ticket, {ErrorCode::io, reason}})).at(0);
    CHECK(failed.reason.size() == string_bytes_max - 1);
}

TEST_CASE("scenes that no tile needs are forgotten beyond the limits, in order of use") {
    Limits limits;
    limits.shelf.idle_count_max = 2;
    SessionDriver driver(test_identity(), limits);
    driver.connect();
    std::vector<Action> actions;
    std::vector<TestScene> scenes;
    for (std::uint32_t i = 0; i < 3; ++i) {
        const TestScene& scene = scenes.emplace_back(10, static_cast<char>('a' + i));
        (void)driver.receive(order(scene, i));
        (void)driver.receive(scene.chunk(0));
        const auto start = of_type<StartTile>(driver.step(SceneCompiled{scene.hash})).at(0);
        actions = driver.step(TileFinished{start.ticket, {}, {}, {}});
    }
    const auto forgotten = of_type<ForgetScene>(actions);
    REQUIRE(forgotten.size() == 1);
    CHECK(forgotten[0].scene == scenes[0].hash);
    CHECK(sent<NeedChunk>(driver.receive(order(scenes[0], 9))).size() == 1);
}

TEST_CASE("where cancelled tiles' scenes are still compiled, a tile waits until there is room") {
    SessionDriver driver; // credit 4, and 8 idle scenes
    driver.connect();
    std::vector<TestScene> scenes;
    for (std::uint32_t i = 0; i < 13; ++i)
        scenes.emplace_back(20 + i);
    for (std::uint32_t i = 0; i < 12; ++i) { // each is given up while its scene is compiled
        (void)driver.receive(order(scenes[i], i));
        CHECK(of_type<CompileScene>(driver.receive(scenes[i].chunk(0))).size() == 1);
        const RenderTile given = order(scenes[i], i);
        CHECK(failure(driver.receive(CancelTile{given.job, given.tile, given.attempt})) ==
              "cancelled: cancelled by the broker");
    }
    auto actions = driver.receive(order(scenes[12], 12));
    CHECK(sent<NeedChunk>(actions).empty());
    CHECK(sent<TileFailed>(actions).empty());
    CHECK(of_type<StartTile>(driver.receive(order(scenes[0], 13))).empty()); // is compiled for it
    actions = driver.step(SceneCompiled{scenes[1].hash});
    CHECK(sent<NeedChunk>(actions).empty()); // it is idle, and one of 8
    CHECK(of_type<StartTile>(driver.step(SceneCompiled{scenes[0].hash})).size() == 1);
    for (std::uint32_t i = 2; i < 9; ++i)
        CHECK(sent<NeedChunk>(driver.step(SceneCompiled{scenes[i].hash})).empty());
    actions = driver.step(SceneCompiled{scenes[9].hash});
    CHECK(of_type<ForgetScene>(actions).size() == 1);
    CHECK(sent<NeedChunk>(actions) == std::vector{NeedChunk{scenes[12].hash, 0}});
    (void)driver.receive(scenes[12].chunk(0));
    CHECK(of_type<StartTile>(driver.step(SceneCompiled{scenes[12].hash})).size() == 1);
}

TEST_CASE("a tile that waits for room can be cancelled") {
    SessionDriver driver;
    driver.connect();
    std::vector<TestScene> scenes;
    for (std::uint32_t i = 0; i < 13; ++i)
        scenes.emplace_back(20 + i);
    for (std::uint32_t i = 0; i < 12; ++i) {
        (void)driver.receive(order(scenes[i], i));
        (void)driver.receive(scenes[i].chunk(0));
        const RenderTile given = order(scenes[i], i);
        (void)driver.receive(CancelTile{given.job, given.tile, given.attempt});
    }
    const RenderTile waiting = order(scenes[12], 12);
    (void)driver.receive(waiting);
    CHECK(failure(driver.receive(CancelTile{waiting.job, waiting.tile, waiting.attempt})) ==
          "cancelled: cancelled by the broker");
    for (std::uint32_t i = 0; i < 12; ++i)
        CHECK(sent<NeedChunk>(driver.step(SceneCompiled{scenes[i].hash})).empty());
}

TEST_CASE("hostile heartbeats are taken as the nearest that makes sense") {
    for (const Duration heartbeat : {Duration::min(), Duration::zero(), Duration::max()})
        for (const std::uint32_t liveness : {0u, UINT32_MAX}) {
            SessionDriver driver;
            (void)driver.step(Tick{});
            Welcome message = welcome();
            message.heartbeat = heartbeat;
            message.liveness = liveness;
            (void)driver.receive(message);
            CHECK(driver.session.next_deadline() > driver.now);
            CHECK(driver.session.next_deadline() <= driver.now + 1h);
        }
}
