// RenderPool: the threads that compile scenes and draw tiles, and the queue where sessions meet
// them.
#pragma once

#include "common/base/bytes.hpp"
#include "common/net/waker.hpp"
#include "common/render/render.hpp"
#include "worker/pool.hpp"

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>
#include <variant>
#include <vector>

namespace fraja::worker {

/// Draws in threads of its own.
class RenderPool final : public Pool {
public:
    /// `done` is woken whenever there are results to take; it must outlive this. At most
    /// `queue_max` deeds may wait for a thread (asserted): a tile each, and for a scene its
    /// compilation for each kernel.
    RenderPool(std::uint32_t threads, std::size_t queue_max, const net::Waker& done);
    /// Stops what runs (a scene that is being compiled first comes to its end) and joins.
    ~RenderPool() override;

    void perform(SessionIndex session, CompileScene action) override;
    /// For a kernel that no tile of the scene has asked for yet, a thread compiles the scene first.
    void perform(SessionIndex session, const StartTile& action) override;
    void perform(SessionIndex session, const StopTile& action) override;
    void perform(SessionIndex session, const ForgetScene& action) override;

    [[nodiscard]] std::vector<PoolResult> take_results() override;
    [[nodiscard]] Instant next_deadline() const override { return Instant::never(); }
    [[nodiscard]] bool is_idle() const override;
    [[nodiscard]] std::vector<TileProgress> progress(SessionIndex session) const override;

private:
    using TileKey = std::pair<SessionIndex, Ticket>;
    using SceneKey = std::pair<SessionIndex, ContentHash>;
    using Compiled = std::shared_ptr<const CompiledScene>;

    /// A scene as it was read, and compiled for each kernel that was asked for: null while a thread
    /// is at it.
    struct LoadedScene {
        std::shared_ptr<const Scene> scene;
        std::map<Kernel, Compiled> compiled;
    };
    struct Reading {
        SceneKey key;
        std::vector<Blob> chunks;
        Kernel kernel{};
    };
    struct Compiling {
        std::shared_ptr<LoadedScene> scene;
        Kernel kernel{};
    };
    struct Drawing {
        TileKey key;
        std::shared_ptr<LoadedScene> scene;
        Compiled compiled; // null while it waits for that
        std::uint32_t pass;
        PixelRect rect;
        protocol::PictureSettings settings;
        std::uint32_t probe_side;
        std::shared_ptr<RenderControl> control;
    };
    using Deed = std::variant<Reading, Compiling, Drawing>;

    void run(const std::stop_token& stop);
    void carry_out(Reading deed);
    void carry_out(Compiling deed);
    void carry_out(Drawing deed);
    void enqueue(Deed deed); // both: the mutex is held
    void finish(PoolResult result);

    const std::size_t queue_max_;
    const net::Waker& done_;

    mutable std::mutex mutex_; // guards everything below but the threads
    std::condition_variable_any deed_added_;
    std::deque<Deed> queue_;
    std::vector<Drawing> waiting_; // for their scene to be compiled for their kernel
    std::map<TileKey, std::shared_ptr<RenderControl>> running_;
    std::map<SceneKey, std::shared_ptr<LoadedScene>> scenes_;
    std::vector<PoolResult> results_;

    std::vector<std::jthread> threads_; // last: joined before what they use is gone
};

/// Pixels as they travel: little-endian 32-bit floats, cut every protocol::chunk_bytes; at least
/// one blob.
[[nodiscard]] std::vector<Blob> pixel_blobs(Tile tile);

} // namespace fraja::worker
