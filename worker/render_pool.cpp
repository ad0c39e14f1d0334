#include "worker/render_pool.hpp"

#include "common/base/guarded.hpp"
#include "common/net/clock.hpp"
#include "common/protocol/content_hash.hpp"
#include "common/protocol/limits.hpp"
#include "common/protocol/passes.hpp"
#include "common/protocol/probe.hpp"
#include "common/scene/raj_reader.hpp"

#include <algorithm>
#include <bit>
#include <limits>
#include <optional>
#include <span>

namespace fraja::worker {
namespace {

Kernel kernel_of(protocol::KernelChoice choice) {
    switch (choice) {
    case protocol::KernelChoice::reference:
        return Kernel::reference;
    case protocol::KernelChoice::fast:
        return Kernel::fast;
    }
    FRAJA_ASSERT(false && "a kernel that does not exist");
    return {};
}

RenderSettings render_settings(const protocol::PictureSettings& s, std::uint32_t pass) {
    RenderSettings settings{.size = s.size,
                            .depth = s.depth,
                            .aa = s.aa,
                            .spp = s.spp,
                            .error = s.error,
                            .max_samples = s.max_samples,
                            .filter = s.filter == protocol::PixelFilter::tent ? Filter::tent
                                                                              : Filter::box,
                            .exact = s.exact,
                            .layers = s.layers};
    if (s.limited_in_time()) {
        const protocol::Pass samples = protocol::pass_of(pass);
        settings.first_sample = samples.first;
        settings.spp = samples.count;
        settings.pass = true;
    }
    return settings;
}

protocol::Rays rays_of(const RayCounts& r) {
    return {.camera = r.camera,
            .reflected = r.reflected,
            .refracted = r.refracted,
            .shadow = r.shadow,
            .box_tests = r.box_tests,
            .form_tests = r.form_tests,
            .shaded = r.shaded,
            .skipped_pixels = r.skipped_pixels,
            .truncated_pixels = r.truncated_pixels};
}

Result<std::shared_ptr<const Scene>> read_scene(std::vector<Blob> chunks, const ContentHash& hash) {
    const Blob text = joined(chunks);
    chunks.clear(); // a large scene need not be here twice
    if (protocol::content_hash(text) != hash)
        return Error{ErrorCode::malformed_frame,
                     "the scene's bytes do not have the hash they were asked for by"};
    auto scene = read_raj(as_text(text), "scene");
    if (!scene)
        return scene.error();
    return std::make_shared<const Scene>(std::move(*scene));
}

struct Drawn {
    std::vector<Blob> blobs;
    RayCounts rays;
};

/// One ray through the middle of each square: how many it leads to.
Result<Drawn> probe(const CompiledScene& scene, const protocol::PictureSettings& settings,
                    const PixelRect& rect, std::uint32_t side, RenderControl& control) {
    RenderSettings plain = render_settings(settings, 0);
    plain = {.size = plain.size, .depth = plain.depth, .exact = plain.exact};
    Tile rays{.rect = rect, .rgb = {}};
    RayCounts all;
    for (std::uint64_t i = 0; i < protocol::probe_squares(rect, side); ++i) {
        const PixelRect square = protocol::probe_square(rect, side, i);
        const PixelRect middle{square.x + square.width / 2, square.y + square.height / 2, 1, 1};
        const auto drawn = scene.render_tile(plain, middle, control);
        if (!drawn)
            return drawn.error();
        rays.rgb.push_back(static_cast<float>(rays_of(drawn->rays).total()));
        all += drawn->rays;
    }
    return Drawn{pixel_blobs(std::move(rays)), all};
}

} // namespace

std::vector<Blob> pixel_blobs(Tile tile) {
    static_assert(std::endian::native == std::endian::little, "pixels travel little-endian");
    static_assert(sizeof(float) == 4 && std::numeric_limits<float>::is_iec559);
    std::vector<Blob> planes;
    for (std::vector<float>* plane :
         {&tile.rgb, &tile.samples, &tile.error, &tile.variance, &tile.cut, &tile.layers})
        if (!plane->empty()) {
            const auto owner = std::make_shared<const std::vector<float>>(std::move(*plane));
            planes.emplace_back(owner, std::as_bytes(std::span(*owner)));
        }
    return cut(joined(planes), protocol::chunk_bytes);
}

RenderPool::RenderPool(std::uint32_t threads, std::size_t queue_max, const net::Waker& done)
    : queue_max_(queue_max), done_(done) {
    threads_.reserve(threads);
    for (std::uint32_t i = 0; i < threads; ++i)
        threads_.emplace_back([this](const std::stop_token& stop) { run(stop); });
}

RenderPool::~RenderPool() {
    for (std::jthread& thread : threads_)
        thread.request_stop();
    const std::lock_guard lock(mutex_);
    queue_.clear();
    waiting_.clear();
    for (const auto& [key, control] : running_)
        control->stop = true;
}

// ------------------------------------------------------------------------------- the owner's side

void RenderPool::perform(SessionIndex session, CompileScene action) {
    const std::lock_guard lock(mutex_);
    enqueue(Reading{{session, action.scene}, std::move(action.chunks), kernel_of(action.kernel)});
}

void RenderPool::perform(SessionIndex session, const StartTile& action) {
    const std::lock_guard lock(mutex_);
    const auto scene = scenes_.find({session, action.scene});
    FRAJA_ASSERT(scene != scenes_.end());
    const Kernel kernel = kernel_of(action.settings.kernel);
    const auto [compiled, is_new] = scene->second->compiled.try_emplace(kernel);
    Drawing drawing{.key = {session, action.ticket},
                    .scene = scene->second,
                    .compiled = compiled->second,
                    .pass = action.pass,
                    .rect = action.rect,
                    .settings = action.settings,
                    .probe_side = action.probe_side,
                    .control = std::make_shared<RenderControl>()};
    if (drawing.compiled)
        return enqueue(std::move(drawing));
    waiting_.push_back(std::move(drawing));
    if (is_new)
        enqueue(Compiling{scene->second, kernel});
}

void RenderPool::perform(SessionIndex session, const StopTile& action) {
    const std::lock_guard lock(mutex_);
    const TileKey key{session, action.ticket};
    std::erase_if(waiting_, [&](const Drawing& drawing) { return drawing.key == key; });
    std::erase_if(queue_, [&](const Deed& deed) {
        const auto* drawing = std::get_if<Drawing>(&deed);
        return drawing && drawing->key == key;
    });
    if (const auto at = running_.find(key); at != running_.end())
        at->second->stop = true;
}

void RenderPool::perform(SessionIndex session, const ForgetScene& action) {
    std::shared_ptr<LoadedScene> last; // freed after the lock: a large scene takes a while
    const std::lock_guard lock(mutex_);
    const auto at = scenes_.find({session, action.scene});
    FRAJA_ASSERT(at != scenes_.end());
    last = std::move(at->second);
    scenes_.erase(at);
}

std::vector<PoolResult> RenderPool::take_results() {
    const std::lock_guard lock(mutex_);
    return std::exchange(results_, {});
}

bool RenderPool::is_idle() const {
    const std::lock_guard lock(mutex_);
    return queue_.empty() && waiting_.empty() && running_.empty();
}

std::vector<TileProgress> RenderPool::progress(SessionIndex session) const {
    const std::lock_guard lock(mutex_);
    std::vector<TileProgress> progress;
    for (const auto& [key, control] : running_)
        if (key.first == session)
            progress.push_back({key.second, control->rays.load(std::memory_order_relaxed)});
    return progress;
}

void RenderPool::enqueue(Deed deed) {
    FRAJA_ASSERT(queue_.size() < queue_max_);
    queue_.push_back(std::move(deed));
    deed_added_.notify_one();
}

// ------------------------------------------------------------------------------ the threads' side

void RenderPool::run(const std::stop_token& stop) {
    for (;;) {
        std::unique_lock lock(mutex_);
        if (!deed_added_.wait(lock, stop, [&] { return !queue_.empty(); }))
            return;
        Deed deed = std::move(queue_.front());
        queue_.pop_front();
        if (const auto* drawing = std::get_if<Drawing>(&deed))
            running_.emplace(drawing->key, drawing->control);
        lock.unlock();
        std::visit([&](auto& d) { carry_out(std::move(d)); }, deed);
    }
}

void RenderPool::carry_out(Reading deed) {
    auto read = guarded([&]() -> Result<std::shared_ptr<LoadedScene>> {
        auto scene = read_scene(std::move(deed.chunks), deed.key.second);
        if (!scene)
            return scene.error();
        return std::make_shared<LoadedScene>(
            LoadedScene{*scene, {{deed.kernel, compile_scene(*scene, deed.kernel)}}});
    });
    const auto [session, hash] = deed.key;
    const std::lock_guard lock(mutex_);
    if (read) {
        scenes_[deed.key] = std::move(*read);
        finish({session, SceneCompiled{hash}});
    } else {
        finish({session, SceneFailed{hash, read.error()}});
    }
}

void RenderPool::carry_out(Compiling deed) {
    const auto compiled = guarded(
        [&]() -> Result<Compiled> { return compile_scene(deed.scene->scene, deed.kernel); });
    const std::lock_guard lock(mutex_);
    if (compiled)
        deed.scene->compiled[deed.kernel] = *compiled;
    else
        deed.scene->compiled.erase(deed.kernel); // the next tile tries anew
    const auto ended =
        std::stable_partition(waiting_.begin(), waiting_.end(), [&](const Drawing& drawing) {
            return drawing.scene != deed.scene || kernel_of(drawing.settings.kernel) != deed.kernel;
        });
    for (Drawing& drawing : std::span(ended, waiting_.end())) {
        if (compiled) {
            drawing.compiled = *compiled;
            enqueue(std::move(drawing));
        } else {
            finish({drawing.key.first, TileBroken{drawing.key.second, compiled.error()}});
        }
    }
    waiting_.erase(ended, waiting_.end());
}

void RenderPool::carry_out(Drawing deed) {
    const Instant begin = net::now();
    auto drawn = guarded([&]() -> Result<Drawn> {
        if (deed.probe_side > 0)
            return probe(*deed.compiled, deed.settings, deed.rect, deed.probe_side, *deed.control);
        auto tile = deed.compiled->render_tile(render_settings(deed.settings, deed.pass), deed.rect,
                                               *deed.control);
        if (!tile)
            return tile.error();
        return Drawn{pixel_blobs(std::move(tile->tile)), tile->rays};
    });
    const Duration elapsed = net::now() - begin;
    const auto [session, ticket] = deed.key;
    const std::lock_guard lock(mutex_);
    running_.erase(deed.key);
    if (deed.control->stop)
        return; // nobody waits for it
    if (drawn)
        finish({session,
                TileFinished{ticket, rays_of(drawn->rays), elapsed, std::move(drawn->blobs)}});
    else
        finish({session, TileBroken{ticket, drawn.error()}});
}

void RenderPool::finish(PoolResult result) {
    results_.push_back(std::move(result));
    done_.wake();
}

} // namespace fraja::worker
