// What another broker wants of this one.
#include "tests/broker/farm.hpp"

namespace fraja::broker {
namespace {

using namespace protocol;
using namespace std::chrono_literals;

Order order_of(std::uint8_t id, const PixelRect& rect) {
    Order order;
    order.id = id_of<JobId>(id);
    order.rect = rect;
    order.scene = scene_hash;
    order.scene_text = Blob(scene_bytes);
    order.settings.size = {200, 100};
    order.settings.crop = {0, 0, 200, 100};
    return order;
}

/// Draws whatever these workers are sent, until they are sent nothing.
void draw_all(Farm& farm, const std::vector<PeerId>& peers) {
    for (bool going = true; going;) {
        going = false;
        farm.now = farm.now + 5ms;
        for (const PeerId& peer : peers)
            for (const RenderTile& tile : farm.tiles(peer)) {
                going = true;
                farm.render(peer, tile);
            }
    }
}

std::uint64_t pixels_of(const OrderFilled& filled) {
    std::uint64_t pixels = 0;
    for (const auto& part : filled.parts)
        pixels += part->rect.pixel_count();
    return pixels;
}

TEST_CASE("an order is split among the workers, and told when all of it is drawn") {
    Farm farm;
    farm.worker_arrives("a", 1, 16, 4);
    farm.worker_arrives("b", 2, 16, 4);
    const Order order = order_of(7, {32, 16, 64, 48});
    farm.event(Ordered{order});
    const auto first = farm.all<RenderTile>("a");
    REQUIRE_FALSE(first.empty());
    CHECK(first[0].job == order.id);
    CHECK(first[0].scene == scene_hash);
    CHECK(first[0].rect.inside(order.rect));
    CHECK(first[0].settings == order.settings); // as if there were no broker between
    CHECK(farm.heard<RenderTile>("b"));
    farm.say("a", NeedChunk{scene_hash, 0});
    CHECK(farm.heard<Chunk>("a")); // its scene is here
    draw_all(farm, {"a", "b"});
    REQUIRE(farm.orders_filled.size() == 1);
    const OrderFilled& filled = farm.orders_filled[0];
    CHECK(filled.id == order.id);
    CHECK(pixels_of(filled) == order.rect.pixel_count());
    CHECK(filled.rays.total() == order.rect.pixel_count());
    CHECK(filled.render_time == 5ms * filled.parts.size()); // what each answer says
    CHECK(farm.dispatcher.job_count() == 0);
}

TEST_CASE("orders are seen, kept and followed by nobody") {
    Farm farm({}, true);
    farm.worker_arrives("w", 1, 1, 1);
    farm.event(Ordered{order_of(7, {0, 0, 32, 32})});
    farm.client_arrives("client");
    farm.say("client", FindJob{""});
    CHECK(farm.last<Refused>("client").code == RefusalCode::no_such_job);
    farm.forget("client");
    farm.say("client", FindJob{to_string(id_of<JobId>(7)).substr(0, 8)});
    CHECK(farm.last<Refused>("client").code == RefusalCode::no_such_job);
    farm.forget("client");
    farm.say("client", ControlJob{id_of<JobId>(7), JobDeed::cancel, 0});
    CHECK(farm.last<Refused>("client").code == RefusalCode::no_such_job);
    farm.forget("client");
    farm.say("client", Repair{id_of<JobId>(7), 10, Bytes(200)});
    CHECK(farm.last<Refused>("client").code == RefusalCode::no_such_job);
    farm.event(TopicSubscribed{std::string(farm_topic)});
    farm.pass(600ms);
    CHECK(farm.published<FarmState>(std::string(farm_topic)).back().jobs.empty());
    draw_all(farm, {"w"});
    CHECK(farm.orders_filled.size() == 1);
    CHECK(farm.persisted.empty());
}

TEST_CASE("orders are drawn one after the other, and the next one fills the gaps") {
    Farm farm;
    farm.worker_arrives("w", 1, 2, 1'000);
    farm.event(Ordered{order_of(9, {0, 0, 32, 32})});
    farm.event(Ordered{order_of(3, {32, 0, 32, 32})});
    const auto tiles = farm.tiles("w");
    const auto second =
        std::ranges::find(tiles, id_of<JobId>(3), [](const RenderTile& tile) { return tile.job; });
    REQUIRE(second != tiles.end());
    CHECK(std::all_of(tiles.begin(), second,
                      [](const RenderTile& tile) { return tile.job == id_of<JobId>(9); }));
    CHECK(std::all_of(second, tiles.end(),
                      [](const RenderTile& tile) { return tile.job == id_of<JobId>(3); }));
}

TEST_CASE("an order shares the farm with jobs of the broker's own") {
    Farm farm;
    farm.event(Ordered{order_of(7, {0, 0, 64, 64})});
    farm.event(Ordered{order_of(8, {64, 0, 64, 64})});
    farm.submit(1, 20);
    farm.worker_arrives("w", 1, 8, 8);
    std::size_t orders = 0;
    const auto tiles = farm.tiles("w");
    for (const RenderTile& tile : tiles)
        orders += tile.job != id_of<JobId>(1);
    CHECK(tiles.size() == 8);
    CHECK(orders == 4);
}

TEST_CASE("an order that is withdrawn stops, without a word") {
    Farm farm;
    farm.worker_arrives("w", 1, 16, 2);
    farm.event(Ordered{order_of(7, {0, 0, 64, 64})});
    const auto tiles = farm.tiles("w");
    REQUIRE(tiles.size() == 2);
    farm.event(OrderWithdrawn{id_of<JobId>(7)});
    CHECK(farm.all<CancelTile>("w").size() == 2);
    farm.say("w", NeedChunk{scene_hash, 0}); // it was about to
    CHECK(farm.heard<Chunk>("w"));
    for (const RenderTile& tile : tiles)
        farm.fail("w", tile, FailureCode::cancelled);
    CHECK(farm.tiles("w").empty());
    CHECK(farm.orders_filled.empty());
    CHECK(farm.orders_failed.empty());
    CHECK(farm.dispatcher.job_count() == 0);
    farm.event(OrderWithdrawn{id_of<JobId>(7)});
    farm.say("w", NeedChunk{scene_hash, 0}); // now nobody needs it
    CHECK(farm.last<Refused>("w").code == RefusalCode::invalid);
}

TEST_CASE("an order fails for the scene's fault at once, and for the machines' in the end") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 1);
    farm.event(Ordered{order_of(7, {0, 0, 64, 64})});
    farm.fail("w", farm.tiles("w").at(0), FailureCode::scene);
    REQUIRE(farm.orders_failed.size() == 1);
    CHECK(farm.orders_failed[0].code == FailureCode::scene);
    CHECK(farm.orders_failed[0].reason == "no luck");
    farm.event(Ordered{order_of(8, {0, 0, 64, 64})});
    for (int i = 0; i < 3; ++i)
        farm.fail("w", farm.tiles("w").at(0), FailureCode::machine);
    REQUIRE(farm.orders_failed.size() == 2);
    CHECK(farm.orders_failed[1].code == FailureCode::machine);
    CHECK(farm.orders_failed[1].reason.find("no luck") != std::string::npos);
    CHECK(farm.dispatcher.job_count() == 0);
}

TEST_CASE("a probe that was ordered goes to one worker as it is") {
    Farm farm;
    farm.worker_arrives("w", 1, 4, 8);
    Order order = order_of(7, {0, 0, 200, 100});
    order.probe_side = 25;
    farm.event(Ordered{order});
    const auto tiles = farm.tiles("w");
    REQUIRE(tiles.size() == 1);
    CHECK(tiles[0].probe_side == 25);
    CHECK(tiles[0].rect == order.rect);
    TileRendered answer = Farm::answer(tiles[0]);
    answer.blobs = {Blob(Bytes(8 * 4 * sizeof(float), std::byte{1}))};
    farm.say("w", answer);
    REQUIRE(farm.orders_filled.size() == 1);
    CHECK((farm.orders_filled[0].probe.at(0) == answer.blobs[0]));
    CHECK(farm.tiles("w").empty());

    order.id = id_of<JobId>(8);
    farm.event(Ordered{order}); // one that is lost is asked for again, but not for ever
    for (int i = 0; i < 3; ++i) {
        CHECK(farm.orders_failed.empty());
        farm.fail("w", farm.tiles("w").at(0), FailureCode::machine);
    }
    CHECK(farm.orders_failed.size() == 1);
    CHECK(farm.dispatcher.job_count() == 0);
}

TEST_CASE("a tile of a pass is drawn in many, all of that pass") {
    Farm farm;
    farm.worker_arrives("w", 1, 4, 100);
    Order order = order_of(7, {32, 32, 32, 32});
    order.settings.time_limit = 10s;
    order.settings.max_samples = 256;
    order.pass = 3;
    farm.event(Ordered{order});
    const auto tiles = farm.tiles("w");
    CHECK(tiles.size() == 16);
    for (const RenderTile& tile : tiles) {
        CHECK(tile.pass == 3);
        farm.render("w", tile);
    }
    REQUIRE(farm.orders_filled.size() == 1);
    CHECK(pixels_of(farm.orders_filled[0]) == order.rect.pixel_count());
    farm.pass(20s); // its own time limit is whose order it is
    CHECK(farm.dispatcher.job_count() == 0);
}

TEST_CASE("what a lost worker had of an order goes to the others") {
    Farm farm;
    farm.worker_arrives("a", 1, 16, 2);
    farm.event(Ordered{order_of(7, {0, 0, 64, 64})});
    CHECK(farm.tiles("a").size() == 2);
    farm.worker_arrives("b", 2, 1, 2);
    farm.event(PeerUnreachable{"a"});
    draw_all(farm, {"b"});
    REQUIRE(farm.orders_filled.size() == 1);
    CHECK(pixels_of(farm.orders_filled[0]) == 64 * 64);
}

TEST_CASE("how far an order is counts what is done and what workers have told") {
    Farm farm;
    farm.worker_arrives("w", 1, 16, 2);
    CHECK(farm.dispatcher.order_progress().empty());
    CHECK(farm.dispatcher.thread_count() == 16);
    farm.event(Ordered{order_of(7, {0, 0, 64, 64})});
    const auto tiles = farm.tiles("w");
    farm.beat("w", 2, tiles, 50);
    REQUIRE(farm.dispatcher.order_progress().size() == 1);
    REQUIRE(tiles.size() == 2);
    CHECK(farm.dispatcher.order_progress()[0].rays == 100);
    farm.render("w", tiles[0]);
    CHECK(farm.dispatcher.order_progress()[0].rays == 50 + tiles[0].rect.pixel_count());
}

TEST_CASE("a job whose scene comes with an order begins, though its client is still sending it") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 8);
    farm.client_arrives("client");
    farm.say("client", Farm::picture(1, 1));
    CHECK(farm.last<NeedChunk>("client").blob == scene_hash);
    farm.forget("client");
    farm.event(Ordered{order_of(7, {0, 0, 64, 64})});
    CHECK(farm.last<JobState>("client").phase == JobPhase::queued);
    draw_all(farm, {"w"});
    CHECK(farm.state(id_of<JobId>(1)).phase == JobPhase::done);
}

TEST_CASE("an order whose scene does not fit fails on this machine's account") {
    Limits limits;
    limits.blob_bytes_max = scene_bytes.size() - 1;
    Farm farm(limits);
    farm.event(Ordered{order_of(7, {0, 0, 64, 64})});
    REQUIRE(farm.orders_failed.size() == 1);
    CHECK(farm.orders_failed[0].code == FailureCode::machine);
    CHECK(farm.dispatcher.job_count() == 0);
}

} // namespace
} // namespace fraja::broker
