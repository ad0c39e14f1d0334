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

WorkerNode::WorkerNode(Farm& farm, Network& network, std::size_t index)
    : farm_(farm), network_(network), index_(index), plan_(farm.scenario.workers[index]) {
    line_.hear = [this](protocol::Message&& message) {
        step(worker::Received{std::move(message)});
    };
    line_.reconnected = [this] { network_.in_process(process_, [this] { flush(); }); };
    process_.tick = [this] {
        worker::Tick tick;
        for (const auto& [ticket, rendering] : rendering_)
            if (!rendering.hangs)
                tick.progress.push_back({ticket, ++progress_});
        step(tick);
    };
}

void WorkerNode::start() {
    network_.begin_life(process_);
    outbox_.clear();
    waiting_.clear();
    rendering_.clear();
    hung_threads_ = 0;
    scenes_.clear();
    session_ = std::make_unique<worker::Session>(
        worker::Identity{farm_.make_id<WorkerId>(), "worker " + std::to_string(index_),
                         plan_.threads, plan_.tags},
        worker::Limits{});
    network_.connect(line_);
    step(worker::Tick{});
}

void WorkerNode::crash() {
    if (!process_.running)
        return;
    network_.disconnect(line_);
    network_.end_life(process_);
    session_.reset();
    farm_.agenda.after(farm_.between(10ms, farm_.scenario.faults.restart_max), [this] { start(); });
}

void WorkerNode::step(const worker::Event& event) {
    farm_.note(2'000 + 100 * index_ + event.index());
    std::vector<worker::Action> actions;
    session_->step(farm_.now(), event, actions);
    for (worker::Action& action : actions)
        std::visit([this](auto& a) { perform(std::move(a)); }, action);
    flush();
    network_.wake(process_, session_->next_deadline());
}

void WorkerNode::flush() {
    while (!outbox_.empty() && network_.to_broker(line_, outbox_.front()))
        outbox_.pop_front();
}

void WorkerNode::perform(worker::Send&& send) {
    if (std::holds_alternative<protocol::WorkerHello>(send.message))
        outbox_.clear();
    outbox_.push_back(std::move(send.message));
}

void WorkerNode::perform(worker::Log&& line) {
    if (line.level != LogLevel::debug)
        farm_.log("worker " + std::to_string(index_) + ": " + line.text);
}

void WorkerNode::perform(worker::Finished&&) {
    farm_.violation("worker " + std::to_string(index_) + " gave up");
}

// ----------------------------------------------------------------------------------- its threads

void WorkerNode::perform(worker::CompileScene&& compile) {
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
    farm_.agenda.after(time, [this, life = process_.life, whole, scene = compile.scene] {
        if (process_.life != life)
            return;
        network_.in_process(process_, [this, whole, scene] {
            if (!whole)
                return step(worker::SceneFailed{scene, {ErrorCode::invalid_scene, "another hash"}});
            scenes_.insert(scene);
            step(worker::SceneCompiled{scene});
        });
    });
}

void WorkerNode::perform(worker::StartTile&& start) {
    if (!scenes_.contains(start.scene))
        farm_.violation("a worker starts a tile of a scene that it has not");
    waiting_.push_back(std::move(start));
    start_waiting();
}

void WorkerNode::start_waiting() {
    while (!waiting_.empty() && rendering_.size() + hung_threads_ < plan_.threads) {
        worker::StartTile tile = std::move(waiting_.front());
        waiting_.pop_front();
        render(std::move(tile));
    }
}

void WorkerNode::render(worker::StartTile&& tile) {
    if (!farm_.healed() && farm_.scenario.faults.hung_tiles > 0 &&
        farm_.rng.unit() < farm_.scenario.faults.hung_tiles) {
        rendering_[tile.ticket] = {farm_.now(), true};
        return;
    }
    rendering_[tile.ticket] = {farm_.now(), false};
    WorkerReport& report = farm_.report.workers[index_];
    report.first_start = std::min(report.first_start, farm_.now().since_start);
    const double rays = rays_of(tile);
    const Duration time = from_seconds(rays / plan_.rays_per_s);
    farm_.agenda.after(
        time, [this, life = process_.life, tile = std::move(tile), time, rays]() mutable {
            if (process_.life != life)
                return;
            network_.in_process(process_, [this, tile = std::move(tile), time, rays] {
                if (rendering_.erase(tile.ticket) > 0)
                    end_tile(tile, time, rays);
            });
        });
}

void WorkerNode::end_tile(const worker::StartTile& tile, Duration time, double rays) {
    moved_ = farm_.now();
    WorkerReport& report = farm_.report.workers[index_];
    report.busy += time;
    report.last_end = farm_.now().since_start;
    ++report.tiles;
    if (tile.probe_side > 0)
        farm_.report.probe += time;
    start_waiting();
    step(worker::TileFinished{
        tile.ticket, {.camera = static_cast<std::uint64_t>(rays) + 1}, time, answer(tile)});
}

/// A thread that hangs does not hear of it. One that is through at that moment tells its tile all
/// the same.
void WorkerNode::perform(worker::StopTile&& stop) {
    std::erase_if(waiting_, [&](const worker::StartTile& t) { return t.ticket == stop.ticket; });
    const auto found = rendering_.find(stop.ticket);
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
        farm_.agenda.after(farm_.delay(), [this, life = process_.life, ticket = stop.ticket] {
            if (process_.life == life)
                network_.in_process(process_, [this, ticket] {
                    step(worker::TileFinished{ticket, {.camera = 1}, 1ms, {black(12)}});
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
