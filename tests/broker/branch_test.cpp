// Between a session with the broker above and this broker's dispatcher.
#include "broker/branch.hpp"

#include "common/protocol/limits.hpp"
#include "tests/broker/farm.hpp"

namespace fraja::broker {
namespace {

using namespace protocol;
using namespace std::chrono_literals;

constexpr worker::SessionIndex session{};

struct Desk {
    std::vector<OrderProgress> progress;
    Branch branch{[this] { return progress; }, Rng(1)};

    explicit Desk(bool with_scene = true) {
        if (!with_scene)
            return;
        compile({Blob(scene_bytes)});
        (void)branch.take_results();
    }
    void compile(std::vector<Blob> chunks) {
        branch.perform(session, worker::CompileScene{scene_hash, std::move(chunks), {}});
    }
    Order start(std::uint64_t ticket, const PixelRect& rect) {
        worker::StartTile tile{.ticket = worker::Ticket{ticket},
                               .scene = scene_hash,
                               .pass = 0,
                               .rect = rect,
                               .settings = {}};
        tile.settings.size = {400, 400};
        tile.settings.crop = {0, 0, 400, 400};
        branch.perform(session, tile);
        const auto events = branch.take_events();
        REQUIRE(events.size() == 1);
        return std::get<Ordered>(events[0]).order;
    }
    static std::shared_ptr<const TileDone> part(const PixelRect& rect, std::uint8_t value) {
        TileDone done;
        done.rect = rect;
        done.blobs = {Blob(Bytes(rect.pixel_count() * 12, std::byte{value}))};
        return std::make_shared<const TileDone>(done);
    }
};

TEST_CASE("a scene is taken for what its hash says, or not at all") {
    Desk desk(false);
    Bytes first(scene_bytes.begin(), scene_bytes.begin() + 10);
    Bytes rest(scene_bytes.begin() + 10, scene_bytes.end());
    desk.compile({Blob(first), Blob(rest)});
    auto results = desk.branch.take_results();
    REQUIRE(results.size() == 1);
    CHECK(std::get<worker::SceneCompiled>(results[0].event).scene == scene_hash);
    CHECK((desk.start(1, {0, 0, 8, 8}).scene_text == Blob(scene_bytes)));
    desk.compile({Blob(rest)});
    results = desk.branch.take_results();
    REQUIRE(results.size() == 1);
    CHECK(std::get<worker::SceneFailed>(results[0].event).error.code == ErrorCode::malformed_frame);
}

TEST_CASE("parts are put together, and the time told is that of an eighth of the workers") {
    Desk desk;
    const Order order = desk.start(5, {100, 50, 20, 10});
    CHECK(order.rect == PixelRect{100, 50, 20, 10});
    desk.branch.take(
        OrderFilled{order.id,
                    {Desk::part({100, 50, 12, 10}, 1), Desk::part({112, 50, 8, 10}, 2)},
                    {},
                    {.camera = 200},
                    4s},
        32);
    const auto results = desk.branch.take_results();
    REQUIRE(results.size() == 1);
    const auto& finished = std::get<worker::TileFinished>(results[0].event);
    CHECK(finished.ticket == worker::Ticket{5});
    CHECK(finished.rays.camera == 200);
    CHECK(finished.elapsed == 1s); // by 4 of the 32 threads
    REQUIRE(finished.blobs.size() == 1);
    REQUIRE(finished.blobs[0].size() == 200 * 12);
    for (std::size_t pixel = 0; pixel < 200; ++pixel)
        CHECK(finished.blobs[0].data()[pixel * 12] ==
              (pixel % 20 < 12 ? std::byte{1} : std::byte{2}));
}

TEST_CASE("what was withdrawn is nobody's when it comes") {
    Desk desk;
    const Order order = desk.start(5, {0, 0, 8, 8});
    desk.branch.perform(session, worker::StopTile{worker::Ticket{5}});
    const auto events = desk.branch.take_events();
    REQUIRE(events.size() == 1);
    CHECK(std::get<OrderWithdrawn>(events[0]).id == order.id);
    desk.branch.take(OrderFilled{order.id, {Desk::part({0, 0, 8, 8}, 1)}, {}, {}, 1s}, 1);
    desk.branch.take(OrderFailed{order.id, FailureCode::machine, "too late"});
    CHECK(desk.branch.take_results().empty());
    desk.branch.perform(session, worker::StopTile{worker::Ticket{5}}); // and nothing to stop
    CHECK(desk.branch.take_events().empty());
}

TEST_CASE("a failure says above whose fault it is") {
    Desk desk;
    for (const auto& [said, told] : {std::pair{FailureCode::scene, ErrorCode::invalid_scene},
                                     std::pair{FailureCode::machine, ErrorCode::io}}) {
        const Order order = desk.start(5, {0, 0, 8, 8});
        desk.branch.take(OrderFailed{order.id, said, "why"});
        const auto results = desk.branch.take_results();
        REQUIRE(results.size() == 1);
        const auto& broken = std::get<worker::TileBroken>(results[0].event);
        CHECK(broken.error.code == told);
        CHECK(broken.error.message == "why");
    }
}

TEST_CASE("progress is told by tickets") {
    Desk desk;
    const Order order = desk.start(5, {0, 0, 8, 8});
    desk.progress = {{order.id, 70}, {id_of<JobId>(1), 9}};
    const auto progress = desk.branch.progress(session);
    REQUIRE(progress.size() == 1);
    CHECK(progress[0].ticket == worker::Ticket{5});
    CHECK(progress[0].rays == 70);
}

} // namespace
} // namespace fraja::broker
