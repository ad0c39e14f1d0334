#include "tests/sim/worker_node.hpp"

#include "common/protocol/passes.hpp"
#include "common/protocol/probe.hpp"
#include "tests/sim/pixels.hpp"

#include <algorithm>
#include <cstring>
#include <map>
#include <string>
#include <utility>
#include <variant>

namespace fraja::sim {

using namespace std::chrono_literals;

namespace {

Blob black(std::size_t size) {
    static std::map<std::size_t, Blob> blobs; // as many as tiles have sizes
    Blob& blob = blobs[size];
    if (blob.empty())
        blob = Blob(Bytes(size));
    return blob;
}

} // namespace

WorkerNode::WorkerNode(Farm& farm, const std::vector<Place>& places, std::size_t index)
    : farm_(farm), index_(index), plan_(farm.scenario.workers[index]) {
    for (const Place& place : places) {
        Way& way = *ways_.emplace_back(std::make_unique<Way>(place, process_));
        way.line.pipe = place.pipe;
        way.line.hear = [this, &way](protocol::Message&& message) {
            if (!way.session)
                return;
            note_term(way, message);
            step(worker::SessionEvent{*way.session, worker::Received{std::move(message)}});
        };
        way.line.reconnected = [this, &way] {
            way.place.network->in_process(process_, [this, &way] { flush(way); });
        };
    }
    process_.tick = [this] {
        std::map<Index, std::vector<worker::TileProgress>> progress;
        for (const auto& [key, rendering] : rendering_)
            if (!rendering.hangs)
                progress[key.first].push_back({key.second, ++progress_});
        worker::CrewTick tick;
        for (auto& [session, tiles] : progress)
            tick.progress.push_back({session, std::move(tiles)});
        step(tick);
    };
}

std::vector<Node> WorkerNode::lines() {
    std::vector<Node> all;
    for (const auto& way : ways_)
        all.push_back({&way->line, way->place.network});
    return all;
}

void WorkerNode::start() {
    ways_.front()->place.network->begin_life(process_);
    waiting_.clear();
    rendering_.clear();
    hung_threads_ = 0;
    scenes_.clear();
    worker::CrewOptions options{.identity = {farm_.make_id<WorkerId>(),
                                             "worker " + std::to_string(index_), plan_.threads,
                                             plan_.tags},
                                .endpoints = {},
                                .first = Index{0},
                                .limits = {}};
    const std::size_t known = 1 + farm_.rng.below(ways_.size());
    for (std::size_t i = 0; i < known; ++i) {
        Way& way = *ways_[i];
        options.endpoints.push_back(way.place.endpoint);
        open(Index(static_cast<std::uint32_t>(i)), way);
    }
    crew_ = std::make_unique<worker::Crew>(std::move(options));
    step(worker::CrewTick{});
}

void WorkerNode::crash() {
    if (!process_.running)
        return;
    for (const auto& way : ways_)
        if (way->session)
            close(*way->session);
    ways_.front()->place.network->end_life(process_);
    crew_.reset();
    farm_.agenda.after(farm_.between(10ms, farm_.scenario.faults.restart_max), [this] { start(); });
}

void WorkerNode::step(const worker::CrewEvent& event) {
    farm_.note(2'000 + 100 * index_ + event.index());
    std::vector<worker::CrewAction> actions;
    crew_->step(farm_.now(), event, actions);
    for (worker::CrewAction& action : actions)
        std::visit([&](auto& deed) { perform(action.session, std::move(deed)); }, action.deed);
    for (const auto& way : ways_)
        flush(*way);
    if (crew_->finished())
        return farm_.violation("worker " + std::to_string(index_) + " gave up");
    ways_.front()->place.network->wake(process_, crew_->next_deadline());
}

void WorkerNode::forget_terms(Way& way) {
    way.broker = {};
    way.others.clear();
    way.told = {};
}

/// Of brokers of which each has named the other a tile of an older term than one has told.
void WorkerNode::note_term(Way& way, const protocol::Message& message) {
    const auto hear = [&](const protocol::Term& term, const std::vector<protocol::Member>& list) {
        way.told = std::max(way.told, term);
        way.others.clear();
        for (const protocol::Member& member : list)
            way.others.insert(member.broker);
    };
    const auto* welcome = std::get_if<protocol::Welcome>(&message);
    if (welcome && way.broker != BrokerId{}) {
        forget_terms(way); // it greets anew
        way.incarnation = 0;
    } else if (welcome && welcome->incarnation == way.incarnation) {
        way.broker = welcome->broker;
        hear(welcome->term, welcome->brokers);
    } else if (const auto* brokers = std::get_if<protocol::Brokers>(&message);
               brokers && way.broker != BrokerId{}) {
        hear(brokers->term, brokers->brokers);
    } else if (const auto* order = std::get_if<protocol::RenderTile>(&message)) {
        protocol::Term known;
        for (const auto& one : ways_)
            if (one->others.contains(way.broker) && way.others.contains(one->broker))
                known = std::max(known, one->told);
        const std::tuple key{order->job, order->tile, order->attempt};
        if (!(order->term < known))
            way.obeyed.insert(key);
        else if (!way.obeyed.contains(key)) // it may come twice
            way.stale.insert(key);
        way.told = std::max(way.told, order->term);
    }
}

bool WorkerNode::obeys_leader_of_before(const protocol::Message& message) const {
    const auto* answer = std::get_if<protocol::TileRendered>(&message);
    return answer && std::ranges::any_of(ways_, [&](const auto& way) {
               const std::tuple key{answer->job, answer->tile, answer->attempt};
               return way->stale.contains(key) && !way->obeyed.contains(key);
           });
}

WorkerNode::Way* WorkerNode::way_of(Index session) {
    const auto found =
        std::ranges::find_if(ways_, [&](const auto& way) { return way->session == session; });
    return found == ways_.end() ? nullptr : found->get();
}

void WorkerNode::open(Index session, Way& way) {
    way.session = session;
    way.outbox.clear();
    forget_terms(way);
    way.obeyed.clear();
    way.stale.clear();
    way.place.network->connect(way.line);
}

void WorkerNode::close(Index session) {
    if (Way* way = way_of(session)) {
        way->place.network->disconnect(way->line);
        ++way->line.socket;
        way->session.reset();
    }
}

void WorkerNode::perform(Index session, worker::Open&& wanted) {
    const auto found = std::ranges::find_if(
        ways_, [&](const auto& way) { return way->place.endpoint == wanted.endpoint; });
    if (found == ways_.end() || (*found)->session)
        return farm_.violation("worker " + std::to_string(index_) + " is to serve " +
                               wanted.endpoint);
    open(session, **found);
}

void WorkerNode::flush(Way& way) {
    while (!way.outbox.empty() && way.place.network->to_broker(way.line, way.outbox.front()))
        way.outbox.pop_front();
}

void WorkerNode::perform(Index session, worker::Send&& send) {
    Way* way = way_of(session);
    if (!way)
        return farm_.violation("a worker speaks to a broker that it does not serve");
    if (const auto* hello = std::get_if<protocol::WorkerHello>(&send.message)) {
        way->outbox.clear();
        forget_terms(*way);
        way->incarnation = hello->incarnation;
    }
    if (obeys_leader_of_before(send.message))
        farm_.violation("worker " + std::to_string(index_) +
                        " draws what a leader of before gave it");
    way->outbox.push_back(std::move(send.message));
}

void WorkerNode::perform(Index, worker::Log&& line) {
    if (line.level != LogLevel::debug)
        farm_.log("worker " + std::to_string(index_) + ": " + line.text);
}

// ----------------------------------------------------------------------------------- its threads

void WorkerNode::perform(Index session, worker::CompileScene&& compile) {
    // The session wants its hash looked at. Comparing with what it is the hash of is the same.
    const Blob* wanted = nullptr;
    for (const auto& [id, submitted] : farm_.submitted)
        if (submitted.job.scene == compile.scene)
            wanted = &submitted.scene;
    std::size_t at = 0;
    bool whole = wanted != nullptr;
    for (const Blob& chunk : compile.chunks) {
        whole = whole && chunk.size() <= wanted->size() - at &&
                std::memcmp(chunk.data(), wanted->data() + at, chunk.size()) == 0;
        at += whole ? chunk.size() : 0;
    }
    whole = whole && at == wanted->size();
    const Duration time = farm_.between(farm_.scenario.compile_min, farm_.scenario.compile_max);
    farm_.agenda.after(time, [this, session, life = process_.life, whole, scene = compile.scene] {
        if (process_.life != life)
            return;
        ways_.front()->place.network->in_process(process_, [this, session, whole, scene] {
            if (!whole)
                return step(worker::SessionEvent{
                    session,
                    worker::SceneFailed{scene, {ErrorCode::invalid_scene, "another hash"}}});
            scenes_.insert({session, scene});
            step(worker::SessionEvent{session, worker::SceneCompiled{scene}});
        });
    });
}

void WorkerNode::perform(Index session, worker::StartTile&& start) {
    if (!scenes_.contains({session, start.scene}))
        farm_.violation("a worker starts a tile of a scene that it has not");
    waiting_.push_back({session, std::move(start)});
    start_waiting();
}

void WorkerNode::start_waiting() {
    while (!waiting_.empty() && rendering_.size() + hung_threads_ < plan_.threads) {
        Waiting next = std::move(waiting_.front());
        waiting_.pop_front();
        render(next.session, std::move(next.tile));
    }
}

void WorkerNode::render(Index session, worker::StartTile&& tile) {
    const TileKey key{session, tile.ticket};
    if (!farm_.healed() && farm_.scenario.faults.hung_tiles > 0 &&
        farm_.rng.unit() < farm_.scenario.faults.hung_tiles) {
        rendering_[key] = {farm_.now(), true};
        return;
    }
    rendering_[key] = {farm_.now(), false};
    WorkerReport& report = farm_.report.workers[index_];
    report.first_start = std::min(report.first_start, farm_.now().since_start);
    const double rays = rays_of(tile);
    const Duration time = from_seconds(rays / plan_.rays_per_s);
    farm_.agenda.after(time, [this, key, life = process_.life, tile = std::move(tile), time,
                              rays]() mutable {
        if (process_.life != life)
            return;
        ways_.front()->place.network->in_process(process_,
                                                 [this, key, tile = std::move(tile), time, rays] {
                                                     if (rendering_.erase(key) > 0)
                                                         end_tile(key.first, tile, time, rays);
                                                 });
    });
}

void WorkerNode::end_tile(Index session, const worker::StartTile& tile, Duration time,
                          double rays) {
    moved_ = farm_.now();
    WorkerReport& report = farm_.report.workers[index_];
    report.busy += time;
    report.last_end = farm_.now().since_start;
    ++report.tiles;
    if (tile.probe_side > 0)
        farm_.report.probe += time;
    start_waiting();
    step(worker::SessionEvent{
        session,
        worker::TileFinished{
            tile.ticket, {.camera = static_cast<std::uint64_t>(rays) + 1}, time, answer(tile)}});
}

/// A thread that hangs does not hear of it. One that is through at that moment tells its tile all
/// the same.
void WorkerNode::perform(Index session, worker::StopTile&& stop) {
    std::erase_if(waiting_, [&](const Waiting& w) {
        return w.session == session && w.tile.ticket == stop.ticket;
    });
    const auto found = rendering_.find({session, stop.ticket});
    if (found == rendering_.end())
        return;
    if (found->second.hangs)
        ++hung_threads_;
    else
        moved_ = farm_.now();
    WorkerReport& report = farm_.report.workers[index_];
    report.stopped += farm_.now() - found->second.since;
    report.last_end = farm_.now().since_start;
    rendering_.erase(found);
    if (!farm_.healed() && farm_.rng.below(4) == 0)
        farm_.agenda.after(farm_.delay(), [this, session, life = process_.life,
                                           ticket = stop.ticket] {
            if (process_.life == life)
                ways_.front()->place.network->in_process(process_, [this, session, ticket] {
                    step(worker::SessionEvent{
                        session, worker::TileFinished{ticket, {.camera = 1}, 1ms, {black(12)}}});
                });
        });
    start_waiting();
}

// ---------------------------------------------------------------------------------- what they draw

Duration WorkerNode::stuck_for() const {
    if (rendering_.empty() || !std::ranges::all_of(rendering_, [](const auto& rendering) {
            return rendering.second.hangs;
        }))
        return Duration::zero();
    Instant moved = moved_;
    for (const auto& [ticket, rendering] : rendering_)
        moved = std::max(moved, rendering.since);
    return farm_.now() - moved;
}

double WorkerNode::rays_of(const worker::StartTile& tile) const {
    if (tile.probe_side > 0) {
        double sum = 0;
        for (const float rays : probe(tile))
            sum += static_cast<double>(rays);
        return sum;
    }
    const double rays = farm_.plan_of(tile.scene).work.rays(tile.rect);
    return tile.settings.limited_in_time()
               ? rays * protocol::pass_of(tile.pass).count / protocol::pass_of(0).count
               : rays;
}

/// Of one camera ray in the middle of each square.
std::vector<float> WorkerNode::probe(const worker::StartTile& tile) const {
    const WorkMap& work = farm_.plan_of(tile.scene).work;
    std::vector<float> rays(protocol::probe_squares(tile.rect, tile.probe_side));
    for (std::size_t i = 0; i < rays.size(); ++i) {
        const PixelRect square = protocol::probe_square(tile.rect, tile.probe_side, i);
        rays[i] = static_cast<float>(
            work.rays({square.x + square.width / 2, square.y + square.height / 2, 1, 1}));
    }
    return rays;
}

std::vector<Blob> WorkerNode::answer(const worker::StartTile& tile) const {
    if (tile.probe_side > 0) {
        const std::vector<float> rays = probe(tile);
        Bytes bytes(rays.size() * sizeof(float));
        std::memcpy(bytes.data(), rays.data(), bytes.size());
        return {Blob(std::move(bytes))};
    }
    if (!farm_.scenario.pixels)
        return {black(tile.rect.pixel_count() * tile.settings.pixel_bytes())};
    Bytes pixels = pixels_of({tile.scene, tile.settings, tile.pass}, tile.rect);
    if (lies_about(tile))
        pixels.front() ^= std::byte{1};
    return {Blob(std::move(pixels))};
}

/// The same each time, as a liar would that is not to be caught at it.
bool WorkerNode::lies_about(const worker::StartTile& tile) const {
    if (plan_.lies <= 0)
        return false;
    Rng rng(farm_.scenario.seed ^ (std::uint64_t{tile.rect.x} << 32 | tile.rect.y));
    return Rng(rng.next() ^ (std::uint64_t{tile.rect.width} << 32 | tile.rect.height)).unit() <
           plan_.lies;
}

} // namespace fraja::sim
