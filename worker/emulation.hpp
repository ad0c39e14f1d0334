// EmulatedPool: workers of stated speeds that answer with true pixels when their time has come, at
// next to no cost: for benchmarks of the broker, with more workers than there are CPUs.
#pragma once

#include "common/net/clock.hpp"
#include "common/net/waker.hpp"
#include "worker/pool.hpp"
#include "worker/render_pool.hpp"
#include "worker/timetable.hpp"
#include "worker/unit_picture.hpp"

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <set>
#include <utility>
#include <vector>

namespace fraja::worker {

struct EmulationLimits {
    std::uint64_t pictures_bytes_max = std::uint64_t{4} << 30; ///< kept for tiles to come
    std::size_t units_at_once = 1024;                          ///< handed to the render threads
};

/// Each session, or so many in a row, is a worker of its own; they share what is drawn. At the
/// first tile of a picture (and of each pass, and of settings) render threads draw all of it, unit
/// by unit; the tiles wait, and their time begins when it is there. From then on only time passes.
///
/// A tile costs what its units cost: squares of 8 pixels, or single pixels where a tile does not
/// keep to such a grid. Adaptive pictures and passes have units of 32, and where a tile ends
/// within one, a part of its rays.
class EmulatedPool final : public Pool {
public:
    struct Options {
        std::vector<double> speeds; ///< of each worker: rays per second and thread
        std::uint32_t threads = 1;  ///< of each worker
        std::uint32_t render_threads = 1;
        std::size_t queue_max = 0; ///< as of RenderPool, of all sessions together
        /// Session i is of worker i / sessions_per_worker; these never use a ticket twice.
        std::uint32_t sessions_per_worker = 1;
        EmulationLimits limits = {};
        std::function<Instant()> clock = net::now;
    };
    /// `done` as of RenderPool.
    EmulatedPool(Options options, const net::Waker& done);

    void perform(SessionIndex session, CompileScene action) override;
    /// Errors of TileBroken: as of RenderPool for any unit of the picture; io when the picture does
    /// not fit into the limit or the memory.
    void perform(SessionIndex session, const StartTile& action) override;
    void perform(SessionIndex session, const StopTile& action) override;
    void perform(SessionIndex session, const ForgetScene& action) override;

    [[nodiscard]] std::vector<PoolResult> take_results() override;
    [[nodiscard]] Instant next_deadline() const override;
    [[nodiscard]] bool is_idle() const override;
    /// A tile that waits for its picture tells how many hundredths of that are there.
    [[nodiscard]] std::vector<TileProgress> progress(SessionIndex session) const override;

private:
    /// A scene is read and compiled once; it is forgotten when the last session forgets it.
    struct SharedScene {
        bool ready = false;
        std::set<SessionIndex> users;
    };
    struct Tile {
        SessionIndex session{};
        Ticket ticket{};
        PixelRect rect;
        std::uint32_t probe_side = 0;
    };
    struct Picture {
        Picture(const StartTile& tile, const UnitPicture::Shape& shape)
            : scene(tile.scene), pass(tile.pass), settings(tile.settings), units(shape) {}
        [[nodiscard]] bool is_there() const { return drawn == units.shape().unit_count(); }
        const ContentHash scene;
        const std::uint32_t pass;
        const protocol::PictureSettings settings;
        UnitPicture units;
        std::uint64_t asked = 0, drawn = 0; // units, from 0 on
        std::vector<Tile> waiting;          // for it to be there
    };
    using PicturePtr = std::shared_ptr<Picture>;
    struct Unit {
        PicturePtr picture;
        std::uint64_t index = 0;
    };
    struct Running {
        SessionIndex session{};
        PicturePtr picture;
        PixelRect rect;
        std::uint32_t probe_side = 0;
    };
    struct Answer {
        protocol::Rays rays;
        std::vector<Blob> blobs;
    };

    [[nodiscard]] PicturePtr find_picture(const StartTile& tile, std::uint32_t unit_side);
    [[nodiscard]] Result<PicturePtr> add_picture(const StartTile& tile, std::uint32_t unit_side);
    [[nodiscard]] Result<void> make_room(std::uint64_t bytes);
    [[nodiscard]] static Answer answer(const UnitPicture& units, const PixelRect& rect,
                                       std::uint32_t probe_side);
    /// In the timetable.
    [[nodiscard]] SessionIndex worker_of(SessionIndex session) const {
        return SessionIndex{static_cast<std::uint32_t>(session) / options_.sessions_per_worker};
    }
    void start(const PicturePtr& picture, const Tile& tile);
    void ask_for_units();
    void abandon(const PicturePtr& picture);

    void finish(SessionIndex session, Event event);
    void on(const SceneCompiled& event);
    void on(const SceneFailed& event);
    void on(const TileFinished& event);
    void on(const TileBroken& event);
    template <class E>
    void on(const E& event); // nothing else comes from a pool

    const Options options_;
    Timetable timetable_;
    std::map<ContentHash, SharedScene> scenes_;
    std::list<PicturePtr> pictures_; // the last used first
    std::uint64_t pictures_bytes_ = 0;
    std::deque<PicturePtr> being_drawn_; // with units that have not been asked for yet
    std::map<Ticket, Unit> units_;       // asked of the painter
    std::uint64_t unit_tickets_ = 0;
    std::map<std::pair<SessionIndex, Ticket>, Running> running_; // of workers in the timetable
    std::vector<PoolResult> results_;
    RenderPool painter_;
};

} // namespace fraja::worker
