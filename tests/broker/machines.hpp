// Pretend workers that take pretend time.
#pragma once

#include "tests/broker/farm.hpp"

#include "common/protocol/probe.hpp"

#include <functional>

namespace fraja::broker {

/// To a probe: so many rays in each square.
template <class Rays>
protocol::TileRendered probed(const protocol::RenderTile& order, Rays rays) {
    Bytes bytes;
    for (std::uint64_t i = 0; i < protocol::probe_squares(order.rect, order.probe_side); ++i) {
        const auto value =
            static_cast<float>(rays(protocol::probe_square(order.rect, order.probe_side, i)));
        const auto* raw = reinterpret_cast<const std::byte*>(&value);
        bytes.insert(bytes.end(), raw, raw + sizeof value);
    }
    protocol::TileRendered answer = Farm::answer(order);
    answer.rays.camera = bytes.size() / 4;
    answer.blobs = {Blob(std::move(bytes))};
    return answer;
}

/// Workers of one thread in pretend time: each renders its tiles in turn, `cost` rays a pixel at
/// `speed` rays a second. Until the job is over; how long that took.
class Machines {
public:
    struct Machine {
        PeerId peer;
        double speed = 1;
        std::vector<protocol::RenderTile> waiting{};
        std::optional<Instant> ends{};
    };
    Machines(Farm& farm, std::vector<Machine> machines, double (*cost)(PixelRect),
             bool honest = true)
        : farm_(farm), machines_(std::move(machines)), cost_(cost), honest_(honest) {
        std::uint8_t id = 0;
        for (const Machine& machine : machines_)
            farm_.worker_arrives(machine.peer, ++id, 1, 2);
    }
    Duration run(const JobId& job) {
        const Instant begin = farm_.now;
        for (int i = 0; i < 200'000 && !protocol::is_over(phase(job)); ++i) {
            take_orders();
            Instant next = farm_.dispatcher.next_deadline();
            for (const Machine& machine : machines_)
                next = std::min(next, machine.ends.value_or(Instant::never()));
            farm_.now = std::max(farm_.now, next);
            for (Machine& machine : machines_)
                if (machine.ends && *machine.ends <= farm_.now)
                    answer(machine);
            farm_.event(Tick{});
            if (watch)
                watch(farm_.state(job));
            if (farm_.now >= next_beat_) {
                next_beat_ = farm_.now + std::chrono::milliseconds(500);
                for (const Machine& machine : machines_) {
                    take_orders(); // what one says may bring another a tile
                    farm_.beat(machine.peer, 2, machine.waiting, ++beats_);
                }
            }
        }
        CHECK(phase(job) == protocol::JobPhase::done);
        const Duration took = farm_.now - begin;
        take_orders(); // what was not wanted any more is stopped
        return took;
    }
    [[nodiscard]] double busy_s() const { return busy_s_; }

    double (*ray_time)(PixelRect) = nullptr; ///< of a tile that begins there, times its speed
    std::function<void(const protocol::JobState&)> watch; ///< after all that happens

private:
    protocol::JobPhase phase(const JobId& job) { return farm_.state(job).phase; }
    void take_orders() {
        for (Machine& machine : machines_) {
            const auto cancelled = farm_.all<protocol::CancelTile>(machine.peer);
            for (const protocol::RenderTile& tile : farm_.tiles(machine.peer))
                machine.waiting.push_back(tile);
            for (const protocol::CancelTile& cancel : cancelled)
                for (std::size_t i = 0; i < machine.waiting.size(); ++i)
                    if (machine.waiting[i].attempt == cancel.attempt) {
                        const protocol::RenderTile tile = machine.waiting[i];
                        machine.waiting.erase(machine.waiting.begin() +
                                              static_cast<std::ptrdiff_t>(i));
                        if (i == 0)
                            machine.ends.reset();
                        farm_.fail(machine.peer, tile, protocol::FailureCode::cancelled);
                        break;
                    }
            begin_next(machine);
        }
    }
    [[nodiscard]] double rays(const protocol::RenderTile& tile) const {
        if (tile.probe_side > 0)
            return static_cast<double>(protocol::probe_squares(tile.rect, tile.probe_side));
        double sum = 0;
        for (std::uint32_t y = tile.rect.y; y < tile.rect.y + tile.rect.height; ++y)
            for (std::uint32_t x = tile.rect.x; x < tile.rect.x + tile.rect.width; ++x)
                sum += cost_({x, y, 1, 1});
        return sum;
    }
    [[nodiscard]] double seconds_of(const Machine& machine,
                                    const protocol::RenderTile& tile) const {
        return rays(tile) / machine.speed * (ray_time ? ray_time(tile.rect) : 1);
    }
    void begin_next(Machine& machine) {
        if (machine.ends || machine.waiting.empty())
            return;
        const double s = seconds_of(machine, machine.waiting.front());
        busy_s_ += s;
        machine.ends = farm_.now + from_seconds(s);
    }
    void answer(Machine& machine) {
        const protocol::RenderTile tile = machine.waiting.front();
        machine.waiting.erase(machine.waiting.begin());
        machine.ends.reset();
        begin_next(machine);
        protocol::TileRendered answer = Farm::answer(tile);
        if (tile.probe_side > 0)
            answer = probed(tile, [&](PixelRect r) {
                return honest_ ? cost_({r.x + r.width / 2, r.y + r.height / 2, 1, 1}) : 1;
            });
        answer.rays.camera = static_cast<std::uint64_t>(rays(tile));
        answer.elapsed = from_seconds(seconds_of(machine, tile));
        farm_.say(machine.peer, answer);
    }

    Farm& farm_;
    std::vector<Machine> machines_;
    double (*cost_)(PixelRect);
    bool honest_; ///< when probed
    Instant next_beat_{};
    std::uint64_t beats_ = 0;
    double busy_s_ = 0;
};

} // namespace fraja::broker
