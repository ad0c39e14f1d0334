#include "tests/worker/session_driver.hpp"
#include "worker/session.hpp"

#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::worker;
using namespace fraja::protocol;
using namespace std::chrono_literals;

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

TEST_CASE("what is beyond the credit is nobody's fault where other brokers have been") {
    SessionDriver driver, other;
    driver.connect();
    SUBCASE("as its session knows") {
        driver.session.set_allies({&other.session});
        driver.session.set_allies({}); // of which none is left
    }
    SUBCASE("as its broker's terms tell") {
        (void)driver.receive(Brokers{{1'000, {}}, {}});
    }
    const TestScene scene(10);
    for (std::uint32_t i = 0; i < 8; ++i)
        CHECK(sent<TileFailed>(driver.receive(order(scene, i))).empty());
    const auto actions = driver.receive(order(scene, 8));
    CHECK(sent<TileFailed>(actions).empty());
    CHECK(sent<WorkerBeat>(actions).at(0).in_flight.size() == 8); // it hears that this is not
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
