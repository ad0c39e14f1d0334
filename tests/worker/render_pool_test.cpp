#include "worker/render_pool.hpp"

#include "common/net/sockets.hpp"
#include "common/protocol/content_hash.hpp"
#include "common/protocol/limits.hpp"
#include "common/scene/raj_reader.hpp"
#include "tests/support/scene_text.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstring>
#include <doctest/doctest.h>
#include <set>
#include <string>

using namespace fraja;
using namespace fraja::worker;
using protocol::KernelChoice;
using namespace std::chrono_literals;

namespace {

constexpr SessionIndex session{0};

struct Bench {
    net::Waker waker;
    RenderPool pool{2, 16, waker};

    ContentHash compile(const Bytes& text, KernelChoice kernel = KernelChoice::fast) {
        CompileScene action{protocol::content_hash(text), {}, kernel};
        constexpr std::size_t piece_bytes = 100;
        for (std::size_t at = 0; at < text.size(); at += piece_bytes) {
            const std::size_t size = std::min(piece_bytes, text.size() - at);
            const auto begin = text.begin() + static_cast<std::ptrdiff_t>(at);
            action.chunks.push_back(Blob(Bytes(begin, begin + static_cast<std::ptrdiff_t>(size))));
        }
        pool.perform(session, action);
        return action.scene;
    }
    /// At least one; fails the test when none comes.
    std::vector<PoolResult> results() {
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
    /// The next result, which comes alone.
    Event next() {
        auto next = results();
        REQUIRE(next.size() == 1);
        return std::move(next[0].event);
    }
    std::vector<TileFinished> some_finished() {
        std::vector<TileFinished> finished;
        for (PoolResult& result : results()) {
            REQUIRE(std::holds_alternative<TileFinished>(result.event));
            finished.push_back(std::get<TileFinished>(std::move(result.event)));
        }
        return finished;
    }
    template <class T>
    T next_as() {
        const Event event = next();
        REQUIRE(std::holds_alternative<T>(event));
        return std::get<T>(event);
    }
};

StartTile whole_picture(Ticket ticket, const ContentHash& scene, Extent size,
                        KernelChoice kernel = KernelChoice::fast) {
    protocol::PictureSettings settings;
    settings.size = size;
    settings.crop = {0, 0, size.width, size.height};
    settings.kernel = kernel;
    return {ticket, scene, 0, settings.crop, settings};
}

/// What the renderer itself draws.
RenderedTile drawn(const Bytes& text, const RenderSettings& settings, Kernel kernel) {
    auto scene = read_raj(as_text(text), "scene");
    REQUIRE(scene.has_value());
    RenderControl control;
    auto tile =
        compile_scene(std::make_shared<const Scene>(std::move(*scene)), kernel)
            ->render_tile(settings, {0, 0, settings.size.width, settings.size.height}, control);
    REQUIRE(tile.has_value());
    return std::move(*tile);
}

} // namespace

TEST_CASE("the pool draws what the kernel draws that a tile asks for, whichever came first") {
    const Bytes text = scene_text("cone.raj");
    const RenderedTile fast = drawn(text, {.size = {32, 24}}, Kernel::fast);
    const RenderedTile reference = drawn(text, {.size = {32, 24}}, Kernel::reference);
    CHECK(fast.rays.box_tests + fast.rays.form_tests > 0);
    CHECK(reference.rays.form_tests == 0);
    for (const KernelChoice first : {KernelChoice::reference, KernelChoice::fast}) {
        Bench bench;
        const ContentHash hash = bench.compile(text, first);
        CHECK(bench.next_as<SceneCompiled>().scene == hash);
        for (const KernelChoice kernel : {KernelChoice::reference, KernelChoice::fast}) {
            CAPTURE(static_cast<int>(first));
            CAPTURE(static_cast<int>(kernel));
            const RenderedTile& want = kernel == KernelChoice::fast ? fast : reference;
            bench.pool.perform(session, whole_picture(Ticket{9}, hash, {32, 24}, kernel));
            const auto tile = bench.next_as<TileFinished>();
            CHECK(tile.ticket == Ticket{9});
            CHECK(tile.rays == protocol::Rays{want.rays.camera, want.rays.reflected,
                                              want.rays.refracted, want.rays.shadow,
                                              want.rays.box_tests, want.rays.form_tests,
                                              want.rays.shaded, want.rays.skipped_pixels,
                                              want.rays.truncated_pixels});
            CHECK(joined(tile.blobs) == joined(pixel_blobs(want.tile)));
            CHECK(bench.pool.progress(session).empty());
        }
    }
}

TEST_CASE("tiles that wait for another kernel are drawn in the end, unless they are stopped") {
    const Bytes text = scene_text("cone.raj");
    Bench bench;
    const ContentHash hash = bench.compile(text, KernelChoice::reference);
    (void)bench.next_as<SceneCompiled>();
    for (const std::uint64_t ticket : {1u, 2u, 3u, 4u, 5u, 6u})
        bench.pool.perform(
            session, whole_picture(Ticket{ticket}, hash, {8, 6},
                                   ticket % 2 ? KernelChoice::fast : KernelChoice::reference));
    bench.pool.perform(session, StopTile{Ticket{3}});
    bench.pool.perform(session, ForgetScene{hash});
    const Blob want[] = {pixel_blobs(drawn(text, {.size = {8, 6}}, Kernel::reference).tile).at(0),
                         pixel_blobs(drawn(text, {.size = {8, 6}}, Kernel::fast).tile).at(0)};
    std::set<std::uint64_t> finished;
    while (!std::ranges::includes(finished, std::array{1u, 2u, 4u, 5u, 6u}))
        for (const TileFinished& tile : bench.some_finished()) {
            const auto ticket = static_cast<std::uint64_t>(tile.ticket);
            CHECK(finished.insert(ticket).second);
            CHECK(tile.blobs.at(0) == want[ticket % 2]);
        }
}

TEST_CASE("a scene that cannot be read says where and why") {
    Bench bench;
    const ContentHash hash = bench.compile(to_bytes("raja.renderer.Scene {\n  sun = 1\n}"));
    const auto failed = bench.next_as<SceneFailed>();
    CHECK(failed.scene == hash);
    CHECK(failed.error.code == ErrorCode::invalid_scene);
    CHECK(failed.error.message.starts_with("scene:2:"));
}

TEST_CASE("bytes that are not those of the hash are not read") {
    Bench bench;
    bench.pool.perform(session, CompileScene{ContentHash{}, {Blob(to_bytes("anything"))}});
    CHECK(bench.next_as<SceneFailed>().error.code == ErrorCode::malformed_frame);
}

TEST_CASE("a tile that runs is stopped quickly, and one that waits never runs") {
    Bench bench;
    const ContentHash hash = bench.compile(scene_text("tumbler.raj"));
    (void)bench.next_as<SceneCompiled>();
    StartTile long_tile = whole_picture(Ticket{0}, hash, {1024, 1024});
    long_tile.settings.aa = 256; // days
    for (const std::uint64_t ticket : {1u, 2u, 3u}) {
        long_tile.ticket = Ticket{ticket};
        bench.pool.perform(session, long_tile);
    }
    const auto moves = [&] {
        const auto progress = bench.pool.progress(session);
        return progress.size() == 2 && progress[0].rays > 0 && progress[1].rays > 0;
    };
    for (int i = 0; i < 6000 && !moves(); ++i)
        std::this_thread::sleep_for(10ms);
    CHECK(moves());
    for (const std::uint64_t ticket : {3u, 1u, 2u})
        bench.pool.perform(session, StopTile{Ticket{ticket}});
    bench.pool.perform(session, whole_picture(Ticket{4}, hash, {4, 3}));
    CHECK(bench.next_as<TileFinished>().ticket == Ticket{4}); // and no word of the others
}

TEST_CASE("a pool with work at hand is destroyed without waiting for it") {
    Bench bench;
    const ContentHash hash = bench.compile(scene_text("tumbler.raj"));
    (void)bench.next_as<SceneCompiled>();
    StartTile long_tile = whole_picture(Ticket{0}, hash, {1024, 1024});
    long_tile.settings.aa = 256;
    for (std::uint64_t ticket = 0; ticket < 8; ++ticket) {
        long_tile.ticket = Ticket{ticket};
        bench.pool.perform(session, long_tile);
    }
}

TEST_CASE("an overlap without a priority is the renderer's error, passed on") {
    Bench bench;
    const ContentHash hash = bench.compile(scene_text("overlap_without_priority.raj"));
    (void)bench.next_as<SceneCompiled>();
    bench.pool.perform(session, whole_picture(Ticket{1}, hash, {64, 48}));
    CHECK(bench.next_as<TileBroken>().error.code == ErrorCode::unresolved_overlap);
}

TEST_CASE("a scene that is forgotten lives as long as its tiles") {
    Bench bench;
    const ContentHash hash = bench.compile(scene_text("cone.raj"));
    (void)bench.next_as<SceneCompiled>();
    bench.pool.perform(session, whole_picture(Ticket{1}, hash, {8, 6}));
    bench.pool.perform(session, ForgetScene{hash});
    CHECK(bench.next_as<TileFinished>().ticket == Ticket{1});
}

TEST_CASE("pixels travel as little-endian floats, cut every chunk") {
    Tile tile{{0, 0, 2, 1}, {1.0f, -2.0f, 0.0f, 0.5f, 65536.0f, 3.0f}};
    const auto blobs = pixel_blobs(tile);
    REQUIRE(blobs.size() == 1);
    REQUIRE(blobs[0].size() == 24);
    const unsigned want[] = {0, 0, 0x80, 0x3f, 0, 0, 0, 0xc0};
    for (std::size_t i = 0; i < std::size(want); ++i)
        CHECK(blobs[0].data()[i] == static_cast<std::byte>(want[i]));

    tile.rgb.assign(protocol::chunk_bytes / 4 * 2 + 1, 1.0f);
    const auto cut = pixel_blobs(tile);
    REQUIRE(cut.size() == 3);
    CHECK(cut[0].size() == protocol::chunk_bytes);
    CHECK(cut[1].size() == protocol::chunk_bytes);
    CHECK(cut[2].size() == 4);
}

TEST_CASE("samples and errors travel behind the colours") {
    const Tile tile{{0, 0, 2, 1}, {1, 2, 3, 4, 5, 6}, {4, 16}, {0.25f, 0.5f}};
    const float want[] = {1, 2, 3, 4, 5, 6, 4, 16, 0.25f, 0.5f};
    const Blob bytes = joined(pixel_blobs(tile));
    REQUIRE(bytes.size() == sizeof(want));
    CHECK(std::memcmp(bytes.data(), want, sizeof(want)) == 0);

    Tile large{{0, 0, 1, 1}, {}};
    large.rgb.assign(protocol::chunk_bytes / 4 - 1, 1.0f);
    large.samples = {2, 3}, large.error = {4, 5}; // the first of them fills the chunk
    const auto cut = pixel_blobs(large);
    REQUIRE(cut.size() == 2);
    CHECK(cut[0].size() == protocol::chunk_bytes);
    CHECK(cut[1].size() == 12);
}

TEST_CASE("the pool draws with the samples that a tile's settings ask for") {
    const Bytes text = scene_text("cone.raj");
    Bench bench;
    const ContentHash hash = bench.compile(text);
    (void)bench.next_as<SceneCompiled>();
    StartTile start = whole_picture(Ticket{1}, hash, {16, 12});
    start.settings.filter = protocol::PixelFilter::tent;
    start.settings.spp = 8;
    bench.pool.perform(session, start);
    const RenderSettings uniform{.size = {16, 12}, .spp = 8, .filter = Filter::tent};
    CHECK(joined(bench.next_as<TileFinished>().blobs) ==
          joined(pixel_blobs(drawn(text, uniform, Kernel::fast).tile)));
    start.settings.spp = 0, start.settings.error = 2, start.settings.max_samples = 32;
    bench.pool.perform(session, start);
    const Tile adaptive =
        drawn(text, {.size = {16, 12}, .error = 2, .max_samples = 32, .filter = Filter::tent},
              Kernel::fast)
            .tile;
    const Blob bytes = joined(bench.next_as<TileFinished>().blobs);
    CHECK(bytes == joined(pixel_blobs(adaptive)));
    CHECK(bytes.size() == start.settings.pixel_bytes() * 16 * 12);
    CHECK(std::ranges::max(adaptive.samples) == 32);
}
