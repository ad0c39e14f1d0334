#include "worker/emulation.hpp"

#include "common/base/assert.hpp"
#include "common/protocol/probe.hpp"

#include <algorithm>
#include <new>
#include <string>
#include <utility>
#include <variant>

namespace fraja::worker {
namespace {

constexpr SessionIndex painted{0}; // the painter has one session
// Units are as small as tiles may be in the end, where there are not too many; of parts of units a
// tile has as large a part.
constexpr std::uint32_t small_units = 2, medium_units = 8;
constexpr std::uint64_t small_units_pixels_max = std::uint64_t{1} << 21;
/// Of adaptive pictures, where a tile draws samples around it, too; and of passes.
constexpr std::uint32_t large_units = 32;

std::uint32_t unit_side_for(const protocol::PictureSettings& s) {
    if (s.error > 0 || s.limited_in_time())
        return large_units;
    return s.crop.pixel_count() <= small_units_pixels_max ? small_units : medium_units;
}

/// Whether they make the same picture. Each submission has another time limit: what is left of it.
bool draw_alike(const protocol::PictureSettings& a, protocol::PictureSettings b) {
    if (a.limited_in_time() && b.limited_in_time())
        b.time_limit = a.time_limit;
    return a == b;
}

/// What RenderPool makes of a probe, but with the mean of a unit in place of one ray.
std::vector<double> probe(const UnitPicture& units, const PixelRect& rect, std::uint32_t side) {
    std::vector<double> rays;
    for (std::uint64_t i = 0; i < protocol::probe_squares(rect, side); ++i) {
        const PixelRect square = protocol::probe_square(rect, side, i);
        const protocol::Rays at =
            units.rays_of_unit({square.x + square.width / 2, square.y + square.height / 2, 1, 1});
        rays.push_back(
            at.camera > 0 ? static_cast<double>(at.total()) / static_cast<double>(at.camera) : 1);
    }
    return rays;
}

} // namespace

EmulatedPool::EmulatedPool(Options options, const net::Waker& done)
    : options_(std::move(options)), timetable_(options_.speeds, options_.threads),
      painter_(options_.render_threads, options_.queue_max + options_.limits.units_at_once, done) {}

// ---------------------------------------------------------------------------------------- scenes

void EmulatedPool::perform(SessionIndex session, CompileScene action) {
    const auto [at, is_new] = scenes_.try_emplace(action.scene);
    at->second.users.insert(session);
    if (at->second.ready)
        finish(session, SceneCompiled{action.scene});
    else if (is_new)
        painter_.perform(painted, std::move(action));
}

void EmulatedPool::perform(SessionIndex session, const ForgetScene& action) {
    const auto at = scenes_.find(action.scene);
    FRAJA_ASSERT(at != scenes_.end());
    at->second.users.erase(session);
    if (!at->second.users.empty())
        return;
    scenes_.erase(at); // pictures of it that are being drawn have tiles waiting: there is none
    painter_.perform(painted, action);
}

void EmulatedPool::on(const SceneCompiled& event) {
    SharedScene& scene = scenes_.at(event.scene);
    scene.ready = true;
    for (const SessionIndex session : scene.users)
        finish(session, event);
}

void EmulatedPool::on(const SceneFailed& event) {
    for (const SessionIndex session : scenes_.at(event.scene).users)
        finish(session, event);
    scenes_.erase(event.scene); // whoever compiles it next tries anew
}

// ----------------------------------------------------------------------------------------- tiles

void EmulatedPool::perform(SessionIndex session, const StartTile& action) {
    const Tile tile{session, action.ticket, action.rect, action.probe_side};
    const std::uint32_t unit_side = unit_side_for(action.settings);
    PicturePtr picture = find_picture(action, unit_side);
    if (!picture) {
        auto added = add_picture(action, unit_side);
        if (!added) {
            finish(session, TileBroken{action.ticket, added.error()});
            return;
        }
        picture = *added;
    }
    if (picture->is_there())
        start(picture, tile);
    else
        picture->waiting.push_back(tile);
    ask_for_units();
}

void EmulatedPool::perform(SessionIndex session, const StopTile& action) {
    if (running_.erase({worker_of(session), action.ticket}) > 0) {
        timetable_.stop(options_.clock(), worker_of(session), action.ticket);
        return;
    }
    const auto is_it = [&](const Tile& tile) {
        return tile.session == session && tile.ticket == action.ticket;
    };
    const auto picture = std::ranges::find_if(
        pictures_, [&](const PicturePtr& p) { return std::erase_if(p->waiting, is_it) > 0; });
    if (picture != pictures_.end() && (*picture)->waiting.empty())
        abandon(PicturePtr(*picture));
}

/// Of a probe, all of it; of a tile, its rays.
EmulatedPool::Answer EmulatedPool::answer(const UnitPicture& units, const PixelRect& rect,
                                          std::uint32_t probe_side) {
    if (probe_side == 0)
        return {units.rays(rect), {}};
    fraja::Tile floats{.rect = rect, .rgb = {}};
    double sum = 0;
    for (const double rays : probe(units, rect, probe_side)) {
        floats.rgb.push_back(static_cast<float>(rays));
        sum += rays;
    }
    const std::uint64_t camera = floats.rgb.size();
    return {{.camera = camera, .reflected = static_cast<std::uint64_t>(sum) - camera},
            pixel_blobs(std::move(floats))};
}

void EmulatedPool::start(const PicturePtr& picture, const Tile& tile) {
    const SessionIndex worker = worker_of(tile.session);
    timetable_.start(options_.clock(), worker, tile.ticket,
                     answer(picture->units, tile.rect, tile.probe_side).rays.total());
    running_.emplace(std::pair(worker, tile.ticket),
                     Running{tile.session, picture, tile.rect, tile.probe_side});
}

std::vector<PoolResult> EmulatedPool::take_results() {
    for (const PoolResult& result : painter_.take_results())
        std::visit([this](const auto& event) { on(event); }, result.event);
    ask_for_units();
    for (const Timetable::Done& done : timetable_.take_done(options_.clock()))
        if (auto tile = running_.extract({done.worker, done.ticket})) {
            const auto& [session, picture, rect, probe_side] = tile.mapped();
            Answer a = answer(picture->units, rect, probe_side);
            if (probe_side == 0)
                a.blobs = picture->units.blobs(rect);
            finish(session, TileFinished{done.ticket, a.rays, done.elapsed, std::move(a.blobs)});
        }
    return std::exchange(results_, {});
}

Instant EmulatedPool::next_deadline() const {
    return results_.empty() ? timetable_.next_deadline() : Instant{};
}

bool EmulatedPool::is_idle() const {
    return running_.empty() && results_.empty() && being_drawn_.empty() && painter_.is_idle();
}

std::vector<TileProgress> EmulatedPool::progress(SessionIndex session) const {
    std::vector<TileProgress> progress = timetable_.progress(options_.clock(), worker_of(session));
    // Of no more tiles than there are threads: the broker lets those wait that have never moved.
    for (const PicturePtr& picture : pictures_)
        for (const Tile& tile : picture->waiting)
            if (tile.session == session && progress.size() < options_.threads)
                progress.push_back(
                    {tile.ticket, 100 * picture->drawn / picture->units.shape().unit_count()});
    return progress;
}

// -------------------------------------------------------------------------------------- pictures

EmulatedPool::PicturePtr EmulatedPool::find_picture(const StartTile& tile,
                                                    std::uint32_t unit_side) {
    const auto at = std::ranges::find_if(pictures_, [&](const PicturePtr& p) {
        return p->units.shape().unit_side == unit_side && p->pass == tile.pass &&
               p->scene == tile.scene && draw_alike(p->settings, tile.settings);
    });
    if (at == pictures_.end())
        return nullptr;
    pictures_.splice(pictures_.begin(), pictures_, at);
    return pictures_.front();
}

Result<EmulatedPool::PicturePtr> EmulatedPool::add_picture(const StartTile& tile,
                                                           std::uint32_t unit_side) {
    const UnitPicture::Shape shape{.area = tile.settings.crop,
                                   .unit_side = unit_side,
                                   .pixel_bytes = tile.settings.pixel_bytes()};
    if (auto room = make_room(shape.memory_bytes()); !room)
        return room.error();
    try {
        pictures_.push_front(std::make_shared<Picture>(tile, shape));
    } catch (const std::bad_alloc&) {
        return Error{ErrorCode::io, "out of memory"};
    }
    pictures_bytes_ += shape.memory_bytes();
    being_drawn_.push_back(pictures_.front());
    return pictures_.front();
}

/// Lets go of the pictures that are there and were used the longest ago.
Result<void> EmulatedPool::make_room(std::uint64_t bytes) {
    const std::uint64_t most = options_.limits.pictures_bytes_max;
    for (auto at = pictures_.end(); pictures_bytes_ + bytes > most && at != pictures_.begin();) {
        --at;
        if ((*at)->is_there()) {
            pictures_bytes_ -= (*at)->units.shape().memory_bytes();
            at = pictures_.erase(at);
        }
    }
    if (pictures_bytes_ + bytes <= most)
        return {};
    return Error{ErrorCode::io, "emulation: a picture takes " + std::to_string(bytes >> 20) +
                                    " MiB; all that are kept at once " +
                                    std::to_string(most >> 20) + " MiB at most"};
}

/// As many as the render threads are given at once, of the pictures in the order of their coming.
void EmulatedPool::ask_for_units() {
    while (!being_drawn_.empty() && units_.size() < options_.limits.units_at_once) {
        const PicturePtr picture = being_drawn_.front();
        const Ticket ticket{++unit_tickets_};
        units_.emplace(ticket, Unit{picture, picture->asked});
        painter_.perform(painted,
                         StartTile{ticket, picture->scene, picture->pass,
                                   picture->units.unit(picture->asked), picture->settings});
        if (++picture->asked == picture->units.shape().unit_count())
            being_drawn_.pop_front();
    }
}

void EmulatedPool::abandon(const PicturePtr& picture) {
    for (const auto& [ticket, unit] : units_)
        if (unit.picture == picture)
            painter_.perform(painted, StopTile{ticket});
    std::erase_if(units_, [&](const auto& entry) { return entry.second.picture == picture; });
    std::erase(being_drawn_, picture);
    pictures_bytes_ -= picture->units.shape().memory_bytes();
    std::erase(pictures_, picture);
}

void EmulatedPool::on(const TileFinished& event) {
    const auto unit = units_.extract(event.ticket);
    if (!unit)
        return; // of a picture that nobody waits for any more
    const auto& [picture, index] = unit.mapped();
    picture->units.place(index, event.blobs, event.rays);
    ++picture->drawn;
    if (picture->is_there())
        for (const Tile& tile : std::exchange(picture->waiting, {}))
            start(picture, tile);
}

void EmulatedPool::on(const TileBroken& event) {
    const auto unit = units_.find(event.ticket);
    if (unit == units_.end())
        return;
    const PicturePtr picture = unit->second.picture;
    for (const Tile& tile : std::exchange(picture->waiting, {}))
        finish(tile.session, TileBroken{tile.ticket, event.error});
    abandon(picture);
}

void EmulatedPool::finish(SessionIndex session, Event event) {
    results_.push_back({session, std::move(event)});
}

template <class E>
void EmulatedPool::on(const E&) {
    FRAJA_ASSERT(!"no word of a pool");
}

} // namespace fraja::worker
