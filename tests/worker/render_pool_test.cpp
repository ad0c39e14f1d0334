#include "worker/render_pool.hpp"

#include "common/net/sockets.hpp"
#include "common/protocol/content_hash.hpp"
#include "common/protocol/limits.hpp"
#include "common/scene/raj_reader.hpp"

#include <chrono>
#include <cstring>
#include <doctest/doctest.h>
#include <fstream>
#include <iterator>
#include <string>

using namespace fraja;
using namespace fraja::worker;
using namespace std::chrono_literals;

namespace {

constexpr SessionIndex session{0};

Bytes scene_text(const std::string& name) {
    std::ifstream file(FRAJA_SOURCE_DIR "/scenes/" + name, std::ios::binary);
    REQUIRE(file);
    return to_bytes(std::string(std::istreambuf_iterator<char>(file), {}));
}

struct Pool {
    net::Waker waker;
    RenderPool pool{2, 16, waker};

    ContentHash compile(const Bytes& text, std::size_t piece_bytes = 100) {
        CompileScene action{protocol::content_hash(text), {}};
        for (std::size_t at = 0; at < text.size(); at += piece_bytes) {
            const std::size_t size = std::min(piece_bytes, text.size() - at);
            const auto begin = text.begin() + static_cast<std::ptrdiff_t>(at);
            action.chunks.push_back(
                make_blob(Bytes(begin, begin + static_cast<std::ptrdiff_t>(size))));
        }
        pool.perform(session, action);
        return action.scene;
    }
    /// The next result; fails the test when none comes.
    Event next() {
        for (int i = 0; i < 600; ++i) {
            waker.drain();
            auto results = pool.take_results();
            REQUIRE(results.size() <= 1);
            if (!results.empty())
                return std::move(results[0].event);
            net::wait({waker.fd()}, 100ms);
        }
        FAIL("no result within a minute");
        return Tick{};
    }
    template <class T>
    T next_as() {
        const Event event = next();
        REQUIRE(std::holds_alternative<T>(event));
        return std::get<T>(event);
    }
};

StartTile whole_picture(Ticket ticket, const ContentHash& scene, Extent size) {
    protocol::PictureSettings settings;
    settings.size = size;
    settings.crop = {0, 0, size.width, size.height};
    return {ticket, scene, settings.crop, settings};
}

Bytes joined(const std::vector<Blob>& blobs) {
    Bytes all;
    for (const Blob& blob : blobs)
        all.insert(all.end(), blob->begin(), blob->end());
    return all;
}

} // namespace

TEST_CASE("the pool draws what the renderer draws") {
    const Bytes text = scene_text("cone.raj");
    auto scene = read_raj(as_text(text), "cone.raj");
    REQUIRE(scene.has_value());
    RenderControl control;
    const auto want = compile_scene(std::make_shared<const Scene>(*scene), Kernel::reference)
                          ->render_tile({.size = {32, 24}}, {0, 0, 32, 24}, control);
    REQUIRE(want.has_value());

    Pool bench;
    const ContentHash hash = bench.compile(text);
    CHECK(bench.next_as<SceneCompiled>().scene == hash);
    bench.pool.perform(session, whole_picture(Ticket{9}, hash, {32, 24}));
    const auto tile = bench.next_as<TileFinished>();
    CHECK(tile.ticket == Ticket{9});
    CHECK(tile.rays.camera == want->rays.camera);
    CHECK(tile.rays.shadow == want->rays.shadow);
    CHECK(joined(tile.blobs) == joined(pixel_blobs(want->tile)));
    CHECK(bench.pool.progress(session).empty());
}

TEST_CASE("a scene that cannot be read says where and why") {
    Pool bench;
    const ContentHash hash = bench.compile(to_bytes("raja.renderer.Scene {\n  sun = 1\n}"));
    const auto failed = bench.next_as<SceneFailed>();
    CHECK(failed.scene == hash);
    CHECK(failed.error.code == ErrorCode::invalid_scene);
    CHECK(failed.error.message.starts_with("scene:2:"));
}

TEST_CASE("bytes that are not those of the hash are not read") {
    Pool bench;
    bench.pool.perform(session, CompileScene{ContentHash{}, {make_blob(to_bytes("anything"))}});
    CHECK(bench.next_as<SceneFailed>().error.code == ErrorCode::malformed_frame);
}

TEST_CASE("a tile that runs is stopped quickly, and one that waits never runs") {
    Pool bench;
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
    Pool bench;
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
    Pool bench;
    const ContentHash hash = bench.compile(scene_text("overlap_without_priority.raj"));
    (void)bench.next_as<SceneCompiled>();
    bench.pool.perform(session, whole_picture(Ticket{1}, hash, {64, 48}));
    CHECK(bench.next_as<TileBroken>().error.code == ErrorCode::unresolved_overlap);
}

TEST_CASE("a scene that is forgotten lives as long as its tiles") {
    Pool bench;
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
    REQUIRE(blobs[0]->size() == 24);
    const unsigned want[] = {0, 0, 0x80, 0x3f, 0, 0, 0, 0xc0};
    for (std::size_t i = 0; i < std::size(want); ++i)
        CHECK((*blobs[0])[i] == static_cast<std::byte>(want[i]));

    tile.rgb.assign(protocol::chunk_bytes / 4 * 2 + 1, 1.0f);
    const auto cut = pixel_blobs(tile);
    REQUIRE(cut.size() == 3);
    CHECK(cut[0]->size() == protocol::chunk_bytes);
    CHECK(cut[1]->size() == protocol::chunk_bytes);
    CHECK(cut[2]->size() == 4);
}
