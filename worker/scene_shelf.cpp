#include "worker/scene_shelf.hpp"

#include "common/base/assert.hpp"

#include <algorithm>

namespace fraja::worker {
namespace {

bool is_idle(const SceneOnShelf& scene) {
    using Stage = SceneOnShelf::Stage;
    return scene.user_count == 0 && (scene.stage == Stage::ready || scene.stage == Stage::refused);
}

} // namespace

SceneOnShelf* SceneShelf::find(const ContentHash& hash) {
    const auto at = scenes_.find(hash);
    return at == scenes_.end() ? nullptr : &at->second;
}

SceneOnShelf& SceneShelf::use(const ContentHash& hash, std::uint64_t total_bytes) {
    const auto [at, is_new] = scenes_.try_emplace(hash);
    SceneOnShelf& scene = at->second;
    if (is_new)
        scene.total_bytes = total_bytes;
    ++scene.user_count;
    scene.last_used = ++uses_;
    return scene;
}

void SceneShelf::release(const ContentHash& hash) {
    const auto at = scenes_.find(hash);
    FRAJA_ASSERT(at != scenes_.end() && at->second.user_count > 0);
    --at->second.user_count;
    if (at->second.user_count == 0 && at->second.stage == SceneOnShelf::Stage::fetching)
        scenes_.erase(at);
}

std::vector<ContentHash> SceneShelf::take_surplus() {
    std::vector<Scenes::iterator> idle;
    std::uint64_t idle_bytes = 0;
    for (auto at = scenes_.begin(); at != scenes_.end(); ++at) {
        if (!is_idle(at->second))
            continue;
        idle.push_back(at);
        idle_bytes += at->second.total_bytes;
    }
    std::ranges::sort(idle, {}, [](Scenes::iterator at) { return at->second.last_used; });

    std::vector<ContentHash> ready;
    std::size_t count = idle.size();
    for (const auto at : idle) {
        if (count <= limits_.idle_count_max && idle_bytes <= limits_.idle_bytes_max)
            break;
        --count;
        idle_bytes -= at->second.total_bytes;
        if (at->second.stage == SceneOnShelf::Stage::ready)
            ready.push_back(at->first);
        scenes_.erase(at);
    }
    return ready;
}

void SceneShelf::note_ask(SceneOnShelf& scene, Instant now) {
    scene.asked = now;
    scene.ask_number = ++asks_;
    ++scene.asks;
}

SceneShelf::Scenes::iterator SceneShelf::oldest_ask() {
    auto oldest = scenes_.end();
    for (auto at = scenes_.begin(); at != scenes_.end(); ++at)
        if (at->second.stage == SceneOnShelf::Stage::fetching &&
            (oldest == scenes_.end() || at->second.ask_number < oldest->second.ask_number))
            oldest = at;
    return oldest;
}

} // namespace fraja::worker
