#include "worker/emulation.hpp"

#include "common/net/sockets.hpp"
#include "common/protocol/content_hash.hpp"
#include "common/protocol/limits.hpp"
#include "tests/support/scene_text.hpp"

#include <algorithm>
#include <chrono>
#include <doctest/doctest.h>
#include <string>

using namespace fraja;
using namespace fraja::worker;
using namespace std::chrono_literals;

namespace {

constexpr SessionIndex one{0}, two{1};

/// The first result within a minute, and what came with it.
std::vector<PoolResult> wait_for_results(Pool& pool, const net::Waker& waker) {
    for (int i = 0; i < 600; ++i) {
        waker.drain();
        auto results = pool.take_results();
        if (!results.empty())
            return results;
        net::wait({waker.fd()}, 100ms);
    }
    FAIL("no result within a minute");
    return {};
}

/// Two workers of 1000 rays a second, whose time the test makes.
struct Emulated {
    explicit Emulated(std::uint32_t threads = 1, EmulationLimits limits = {},
                      std::uint32_t sessions_per_worker = 1)
        : pool({.speeds = {1000, 1000},
                .threads = threads,
                .render_threads = 2,
                .queue_max = 16,
                .sessions_per_worker = sessions_per_worker,
                .limits = limits,
                .clock = [this] { return now; }},
               waker) {}

    net::Waker waker;
    Instant now{1h};
    EmulatedPool pool;

    ContentHash compile(SessionIndex session, const Bytes& text) {
        const ContentHash hash = protocol::content_hash(text);
        pool.perform(session, CompileScene{hash, {Blob(text)}, {}});
        const auto results = wait_for_results(pool, waker);
        REQUIRE(results.size() == 1);
        CHECK(results[0].session == session);
        REQUIRE(std::holds_alternative<SceneCompiled>(results[0].event));
        return hash;
    }
    /// Until the picture is there that tiles wait for.
    void wait_for_picture() {
        const Instant end = net::now() + 1min;
        while (pool.next_deadline() == Instant::never() && net::now() < end) {
            net::wait({waker.fd()}, 100ms);
            waker.drain();
            REQUIRE(pool.take_results().empty());
        }
        REQUIRE(pool.next_deadline() > now);
        REQUIRE(pool.next_deadline() < Instant::never());
    }
    std::vector<TileFinished> take_finished() {
        std::vector<TileFinished> finished;
        for (PoolResult& result : pool.take_results()) {
            REQUIRE(std::holds_alternative<TileFinished>(result.event));
            finished.push_back(std::get<TileFinished>(std::move(result.event)));
        }
        return finished;
    }
    TileFinished next_finished() {
        wait_for_picture();
        now = pool.next_deadline();
        auto finished = take_finished();
        REQUIRE(finished.size() == 1);
        return std::move(finished[0]);
    }
};

StartTile tile_of(Ticket ticket, const ContentHash& scene, PixelRect rect, Extent size = {64, 48}) {
    protocol::PictureSettings settings;
    settings.size = size;
    settings.crop = {0, 0, size.width, size.height};
    return {ticket, scene, 0, rect, settings};
}

} // namespace

TEST_CASE("an emulated worker's tiles are a true worker's, byte for byte") {
    const Bytes text = scene_text("overlapping_spheres.raj");
    const ContentHash hash = protocol::content_hash(text);
    net::Waker waker;
    RenderPool truth(2, 16, waker);
    truth.perform(one, CompileScene{hash, {Blob(text)}, {}});
    (void)wait_for_results(truth, waker);
    Emulated bench;
    (void)bench.compile(one, text);

    const auto plain = [](protocol::PictureSettings&) {};
    struct Row {
        const char* what;
        void (*set)(protocol::PictureSettings&);
        std::uint32_t pass = 0;
        bool same_rays = true;
    };
    for (const Row& row :
         {Row{"plain", plain}, Row{"aa", [](auto& s) { s.aa = 2; }},
          Row{"spp", [](auto& s) { s.spp = 3; }}, Row{"estimates", [](auto& s) { s.spp = 8; }},
          Row{"error", [](auto& s) { s.error = 3, s.max_samples = 32; }, 0, false},
          Row{"pass", [](auto& s) { s.time_limit = 1h; }, 2, false},
          Row{"crop",
              [](auto& s) {
                  s.crop = {5, 3, 55, 45};
              }},
          Row{"reference", [](auto& s) { s.kernel = protocol::KernelChoice::reference; }}}) {
        CAPTURE(std::string(row.what));
        std::uint64_t ticket = 0;
        for (const PixelRect rect : {PixelRect{8, 8, 32, 24}, PixelRect{32, 40, 24, 8},
                                     PixelRect{7, 5, 1, 1}, PixelRect{9, 3, 37, 41}}) {
            StartTile start = tile_of(Ticket{++ticket}, hash, rect);
            row.set(start.settings);
            start.pass = row.pass;
            truth.perform(one, start);
            const auto results = wait_for_results(truth, waker);
            REQUIRE(std::holds_alternative<TileFinished>(results.at(0).event));
            const auto& want = std::get<TileFinished>(results[0].event);
            bench.pool.perform(one, start);
            const TileFinished tile = bench.next_finished();
            CHECK(tile.ticket == start.ticket);
            CHECK((tile.blobs == want.blobs));
            CHECK(seconds(tile.elapsed) ==
                  doctest::Approx(static_cast<double>(tile.rays.total()) / 1000));
            const bool whole_units =
                rect.x % 2 == 0 && rect.y % 2 == 0 && rect.width % 2 == 0 && rect.height % 2 == 0;
            if (row.same_rays && whole_units)
                CHECK(tile.rays.total() == want.rays.total());
            else
                CHECK(tile.rays.total() > 0);
        }
    }
}

TEST_CASE("a tile larger than a chunk is cut as a true worker's") {
    Emulated bench;
    const ContentHash hash = bench.compile(one, scene_text("cone.raj"));
    bench.pool.perform(one, tile_of(Ticket{1}, hash, {0, 0, 256, 256}, {256, 256}));
    const TileFinished tile = bench.next_finished();
    REQUIRE(tile.blobs.size() == 2);
    CHECK(tile.blobs[0].size() == protocol::chunk_bytes);
    CHECK(tile.blobs[1].size() == 256 * 256 * 12 - protocol::chunk_bytes);
}

TEST_CASE("tiles wait for their picture, and their time begins when it is there") {
    Emulated bench;
    const ContentHash hash = bench.compile(one, scene_text("cone.raj"));
    CHECK(bench.compile(two, scene_text("cone.raj")) == hash); // read once
    bench.pool.perform(one, tile_of(Ticket{1}, hash, {0, 0, 32, 32}));
    bench.pool.perform(one, tile_of(Ticket{2}, hash, {32, 0, 32, 32}));
    bench.pool.perform(two, tile_of(Ticket{1}, hash, {0, 32, 64, 16}));
    bench.now = bench.now + 5s;
    const auto begin = bench.now;
    bench.wait_for_picture();
    CHECK(bench.pool.progress(one).size() == 1);
    bench.now = bench.now + 10min; // nobody looks; the second tile of `one` followed the first
    std::vector<Duration> elapsed;
    for (const TileFinished& tile : bench.take_finished())
        elapsed.push_back(tile.elapsed);
    REQUIRE(elapsed.size() == 3);
    bench.pool.perform(one, tile_of(Ticket{3}, hash, {0, 0, 64, 48}));
    const TileFinished whole = bench.next_finished(); // of the same picture: at once
    CHECK(whole.elapsed == elapsed[0] + elapsed[1] + elapsed[2]);
    CHECK(bench.now == begin + 10min + whole.elapsed);
}

TEST_CASE("a picture that nobody waits for any more is not drawn, and drawn anew when asked for") {
    Emulated bench;
    const ContentHash hash = bench.compile(one, scene_text("tumbler.raj"));
    StartTile endless = tile_of(Ticket{1}, hash, {0, 0, 1024, 1024}, {1024, 1024});
    endless.settings.aa = 256; // days
    bench.pool.perform(one, endless);
    CHECK(bench.pool.progress(one).size() == 1);
    bench.pool.perform(one, StopTile{Ticket{1}});
    CHECK(bench.pool.progress(one).empty());
    bench.pool.perform(one, tile_of(Ticket{2}, hash, {0, 0, 8, 8}, {8, 8}));
    CHECK(bench.next_finished().ticket == Ticket{2});
    bench.pool.perform(one, ForgetScene{hash});
    CHECK(bench.compile(one, scene_text("tumbler.raj")) == hash);
    bench.pool.perform(one, tile_of(Ticket{3}, hash, {0, 0, 8, 8}, {8, 8}));
    CHECK(bench.next_finished().ticket == Ticket{3});
}

TEST_CASE("a tile that is stopped makes room for the next at once") {
    Emulated bench;
    const ContentHash hash = bench.compile(one, scene_text("cone.raj"));
    bench.pool.perform(one, tile_of(Ticket{1}, hash, {0, 0, 64, 48}));
    bench.pool.perform(one, tile_of(Ticket{2}, hash, {0, 0, 8, 8}));
    bench.wait_for_picture();
    bench.now = bench.now + 1ms;
    bench.pool.perform(one, StopTile{Ticket{1}});
    const Instant begin = bench.now;
    const TileFinished tile = bench.next_finished();
    CHECK(tile.ticket == Ticket{2});
    CHECK(bench.now == begin + tile.elapsed);
}

TEST_CASE("pictures are kept within the limit: the oldest goes, and what never fits is said") {
    const std::uint64_t bytes =
        UnitPicture::Shape{.area = {0, 0, 64, 48}, .unit_side = 2}.memory_bytes();
    Emulated bench(1, {.pictures_bytes_max = bytes});
    const ContentHash hash = bench.compile(one, scene_text("cone.raj"));
    for (const std::uint32_t depth : {5u, 4u, 5u}) {
        StartTile tile = tile_of(Ticket{depth}, hash, {0, 0, 8, 8});
        tile.settings.depth = depth;
        bench.pool.perform(one, tile);
        CHECK(bench.next_finished().ticket == Ticket{depth});
    }
    StartTile larger = tile_of(Ticket{9}, hash, {0, 0, 8, 8});
    larger.settings.size = {66, 48};
    larger.settings.crop = {0, 0, 66, 48};
    bench.pool.perform(one, larger);
    const auto results = bench.pool.take_results();
    REQUIRE(results.size() == 1);
    const auto* broken = std::get_if<TileBroken>(&results[0].event);
    REQUIRE(broken);
    CHECK(broken->error.code == ErrorCode::io);
    CHECK(broken->error.message.starts_with("emulation: a picture takes "));
}

TEST_CASE(
    "what the renderer refuses breaks all tiles of the picture, and a scene all its sessions") {
    Emulated bench;
    const ContentHash hash = bench.compile(one, scene_text("overlap_without_priority.raj"));
    bench.pool.perform(one, tile_of(Ticket{1}, hash, {0, 0, 64, 48}));
    bench.pool.perform(one, tile_of(Ticket{2}, hash, {0, 0, 8, 8}));
    const auto results = wait_for_results(bench.pool, bench.waker);
    REQUIRE(results.size() == 2);
    for (const PoolResult& result : results) {
        const auto* broken = std::get_if<TileBroken>(&result.event);
        REQUIRE(broken);
        CHECK(broken->error.code == ErrorCode::unresolved_overlap);
    }
    const Bytes rubbish = to_bytes("raja.renderer.Scene {\n  sun = 1\n}");
    for (const SessionIndex session : {one, two})
        bench.pool.perform(session,
                           CompileScene{protocol::content_hash(rubbish), {Blob(rubbish)}, {}});
    const auto failed = wait_for_results(bench.pool, bench.waker);
    REQUIRE(failed.size() == 2);
    CHECK(std::holds_alternative<SceneFailed>(failed[0].event));
    CHECK(std::holds_alternative<SceneFailed>(failed[1].event));
}

TEST_CASE("a picture with a time limit is drawn once, however much of that is left") {
    Emulated bench;
    const ContentHash scene = bench.compile(one, scene_text("cone.raj"));
    StartTile first = tile_of(Ticket{1}, scene, {0, 0, 32, 32});
    first.settings.time_limit = 1h;
    bench.pool.perform(one, first);
    (void)bench.next_finished();
    StartTile again = tile_of(Ticket{2}, scene, {0, 0, 32, 32});
    again.settings.time_limit = 1h - 1ms;
    bench.pool.perform(one, again);
    CHECK(bench.pool.next_deadline() < Instant::never());        // it runs already
    StartTile other = tile_of(Ticket{3}, scene, {0, 0, 32, 32}); // without a limit: another one
    (void)bench.next_finished();
    bench.pool.perform(one, other);
    CHECK(bench.pool.next_deadline() == Instant::never());
    (void)bench.next_finished();
}

TEST_CASE("the sessions of one emulated worker share its threads") {
    Emulated bench(1, {}, 2);
    constexpr SessionIndex another{2}; // of the second worker
    const Bytes text = scene_text("cone.raj");
    ContentHash hash;
    for (const SessionIndex session : {one, two, another})
        hash = bench.compile(session, text);
    const PixelRect rect{0, 0, 64, 48};
    bench.pool.perform(one, tile_of(Ticket{1}, hash, rect));
    bench.pool.perform(two, tile_of(Ticket{2}, hash, rect));
    bench.pool.perform(another, tile_of(Ticket{1}, hash, rect));
    bench.wait_for_picture();
    bench.now = bench.pool.next_deadline();
    std::vector<PoolResult> first = bench.pool.take_results();
    REQUIRE(first.size() == 2); // at one time, as they are of two workers
    std::ranges::sort(first, {}, &PoolResult::session);
    CHECK(first[0].session == one);
    CHECK(first[1].session == another);
    const Duration time = std::get<TileFinished>(first[0].event).elapsed;
    CHECK(bench.pool.next_deadline() == bench.now + time); // the second began when the first ended
    bench.pool.perform(two, StopTile{Ticket{2}});
    CHECK(bench.pool.next_deadline() == Instant::never());
}
