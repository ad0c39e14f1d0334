// SceneShelf: which scenes a worker has, which are on their way, and which must go.
#pragma once

#include "common/base/bytes.hpp"
#include "common/base/ids.hpp"
#include "common/base/instant.hpp"

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace fraja::worker {

/// Scenes that no tile needs are kept within both; those in use are always kept.
struct ShelfLimits {
    /// Of scene text. What is compiled from it takes several times as much.
    std::uint64_t idle_bytes_max = std::uint64_t{256} << 20;
    std::size_t idle_count_max = 8;
};

struct SceneOnShelf {
    /// fetching: chunks come. compiling. ready: tiles can start. refused: it cannot be drawn.
    enum class Stage : std::uint8_t { fetching, compiling, ready, refused };
    Stage stage = Stage::fetching;
    std::uint64_t total_bytes = 0;
    std::uint32_t user_count = 0; ///< tiles in flight that need it
    std::uint64_t last_used = 0;  ///< counts uses of the shelf; the lowest goes first
    // while fetching
    std::vector<Blob> chunks;
    std::uint64_t fetched_bytes = 0;
    Instant asked{};              ///< when the chunk at fetched_bytes was asked for
    std::uint64_t ask_number = 0; ///< which of all asks that was; answers come in their order
    std::uint32_t asks = 0;       ///< how often that chunk was asked for
    std::string reason;           ///< of refused
};

class SceneShelf {
public:
    using Scenes = std::map<ContentHash, SceneOnShelf>;

    explicit SceneShelf(const ShelfLimits& limits) : limits_(limits) {}

    /// Null when it is not here. Valid until it is erased or taken away.
    [[nodiscard]] SceneOnShelf* find(const ContentHash& hash);
    /// The scene with one user more, and new (fetching, nothing asked yet) when it was not here.
    SceneOnShelf& use(const ContentHash& hash, std::uint64_t total_bytes);
    /// One user less. A scene that is still fetching and has none left is erased.
    void release(const ContentHash& hash);
    void erase(const ContentHash& hash) { scenes_.erase(hash); }
    /// Erases what is idle beyond the limits, longest unused first; returns those that were ready.
    [[nodiscard]] std::vector<ContentHash> take_surplus();

    /// Notes that the next chunk of the scene is asked for now.
    void note_ask(SceneOnShelf& scene, Instant now);
    /// The fetching scene whose chunk was asked for the longest ago: the next to be answered.
    [[nodiscard]] Scenes::iterator oldest_ask();

    [[nodiscard]] Scenes& scenes() { return scenes_; }
    [[nodiscard]] const Scenes& scenes() const { return scenes_; }

private:
    ShelfLimits limits_;
    Scenes scenes_;
    std::uint64_t uses_ = 0, asks_ = 0;
};

} // namespace fraja::worker
