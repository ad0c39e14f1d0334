// The load of the broker's benchmark: workers that answer at once, and watchers that only read. On
// bare ZeroMQ, as the loop that the broker is compared with: so that they cost as little as can be,
// and the same to both.
#pragma once

#include "common/base/bytes.hpp"
#include "common/base/ids.hpp"
#include "common/net/keys.hpp"

#include <atomic>
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <thread>

namespace fraja {

using BenchClock = std::chrono::steady_clock;

struct LoadOptions {
    std::uint32_t workers = 64, credit = 2, tiles = 20'000, tile_bytes = 24 << 10;
    std::optional<net::Keys> keys{}; ///< of the workers
};

/// The message's number in its header; 0: that is none.
[[nodiscard]] std::uint16_t message_type(std::string_view header);
/// The body of a TileRendered that answers a RenderTile of that body.
[[nodiscard]] std::string answer_to(std::string_view order);

/// A thread with so many workers. It notes when the orders came.
class WorkerLoad {
public:
    WorkerLoad(std::string endpoint, const LoadOptions& options);

    [[nodiscard]] bool all_welcome() const { return welcomes_ >= options_.workers; }
    [[nodiscard]] std::uint32_t orders() const { return orders_; }
    /// Orders per second between the first tenth and the last one; after that.
    [[nodiscard]] double orders_per_s() const;

private:
    void run(const std::stop_token& stop, const std::string& endpoint);
    void count_order();

    const LoadOptions options_;
    std::atomic<std::uint32_t> welcomes_ = 0, orders_ = 0;
    BenchClock::time_point begin_, end_;
    std::jthread thread_;
};

/// A thread with so many watchers of one job. The constructor returns when all are subscribed.
class WatcherLoad {
public:
    WatcherLoad(std::string stream, std::uint32_t count, const JobId& job);
    /// That came, of all watchers.
    [[nodiscard]] std::uint64_t tiles() const { return tiles_; }

private:
    void run(const std::stop_token& stop, const std::string& stream, const JobId& job);

    const std::uint32_t count_;
    std::atomic<std::uint32_t> ready_ = 0;
    std::atomic<std::uint64_t> tiles_ = 0;
    std::jthread thread_;
};

/// What there must be at least: a ROUTER that sends so many orders, one for each answer, and looks
/// at nothing. Orders per second, as of WorkerLoad.
[[nodiscard]] double bare_orders_per_s(const LoadOptions& options);

} // namespace fraja
