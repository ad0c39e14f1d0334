#include "worker/timetable.hpp"

#include "common/base/assert.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

namespace fraja::worker {
namespace {

constexpr Duration tile_time_max = std::chrono::hours(24 * 365); ///< so that instants do not end

Duration time_for(std::uint64_t rays, double speed) {
    const double nanoseconds = static_cast<double>(rays) / speed * 1e9;
    const auto most = static_cast<double>(tile_time_max.count());
    return Duration(std::llround(std::min(nanoseconds, most)));
}

} // namespace

Timetable::Timetable(std::vector<double> speeds, std::uint32_t threads) : threads_(threads) {
    FRAJA_ASSERT(threads > 0);
    for (const double speed : speeds) {
        FRAJA_ASSERT(speed > 0);
        workers_.push_back({.speed = speed, .running = {}, .waiting = {}});
    }
}

void Timetable::start(Instant now, SessionIndex worker, Ticket ticket, std::uint64_t rays) {
    advance(now);
    at(worker).waiting.push_back({.ticket = ticket, .rays = rays});
    if (at(worker).running.size() < threads_)
        begin_next(now, worker);
}

void Timetable::stop(Instant now, SessionIndex worker, Ticket ticket) {
    advance(now);
    Worker& w = at(worker);
    const auto is_it = [&](const Tile& tile) { return tile.ticket == ticket; };
    std::erase_if(w.waiting, is_it);
    const auto tile = std::ranges::find_if(w.running, is_it);
    if (tile == w.running.end())
        return;
    ends_.erase({tile->end, worker, ticket});
    w.running.erase(tile);
    begin_next(now, worker);
}

std::vector<Timetable::Done> Timetable::take_done(Instant now) {
    advance(now);
    return std::exchange(done_, {});
}

Instant Timetable::next_deadline() const {
    if (!done_.empty())
        return {};
    return ends_.empty() ? Instant::never() : std::get<Instant>(*ends_.begin());
}

std::vector<TileProgress> Timetable::progress(Instant now, SessionIndex worker) const {
    std::vector<TileProgress> progress;
    for (const Tile& tile : workers_.at(static_cast<std::size_t>(worker)).running) {
        const double whole = seconds(tile.end - tile.begin);
        const double share = whole > 0 ? std::min(seconds(now - tile.begin) / whole, 1.0) : 1.0;
        progress.push_back(
            {tile.ticket, static_cast<std::uint64_t>(share * static_cast<double>(tile.rays))});
    }
    return progress;
}

/// Whatever ends up to `now` ends, and what waited for it begins then.
void Timetable::advance(Instant now) {
    while (!ends_.empty() && std::get<Instant>(*ends_.begin()) <= now) {
        const auto [end, worker, ticket] = ends_.extract(ends_.begin()).value();
        std::vector<Tile>& running = at(worker).running;
        const auto tile = std::ranges::find(running, ticket, &Tile::ticket);
        done_.push_back({worker, ticket, end - tile->begin});
        running.erase(tile);
        begin_next(end, worker);
    }
}

void Timetable::begin_next(Instant begin, SessionIndex worker) {
    Worker& w = at(worker);
    if (w.waiting.empty())
        return;
    Tile tile = w.waiting.front();
    w.waiting.pop_front();
    tile.begin = begin;
    tile.end = begin + time_for(tile.rays, w.speed);
    ends_.insert({tile.end, worker, tile.ticket});
    w.running.push_back(tile);
}

} // namespace fraja::worker
