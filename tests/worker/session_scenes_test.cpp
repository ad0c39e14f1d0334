#include "tests/worker/session_driver.hpp"
#include "worker/session.hpp"

#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::worker;
using namespace fraja::protocol;
using namespace std::chrono_literals;

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

TEST_CASE("a session that has stood still gives no scene up for that") {
    SessionDriver driver;
    driver.connect();
    const TestScene scene(10);
    (void)driver.receive(order(scene, 0));
    CHECK(sent<NeedChunk>(driver.pass_with_beats(14s)).size() == 4); // and the first
    driver.now = driver.now + 30s;
    const auto actions = driver.receive(Beat{}); // it was said meanwhile, as much else may be
    CHECK(sent<TileFailed>(actions).empty());
    CHECK(sent<NeedChunk>(actions).size() == 1);
    CHECK(failure(driver.pass_with_beats(4s)) ==
          "machine: the broker does not send the scene, asked 6 times");
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
