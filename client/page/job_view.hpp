// JobView: one job as all see it who look at it in their browsers. One conversation with the broker
// feeds it; any thread may ask for what it shows.
#pragma once

#include "client/page/heat_map.hpp"
#include "client/page/overview.hpp"
#include "client/page/shown.hpp"
#include "client/picture.hpp"
#include "client/progress.hpp"
#include "client/shell.hpp"

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

namespace fraja::client {

/// What can be seen of a job: an overview, two maps, and all pixels exactly.
enum class Layer : std::uint8_t { overview, costs, workers, pixels };

/// Whether a conversation that ended so has brought all there is of its job, as long as that is
/// over.
[[nodiscard]] bool has_brought_all(const Outcome& outcome);

class JobView final : public Listener {
public:
    /// `admits` is asked before a picture of so many pixels is kept. Revisions count from beyond
    /// `earlier`: browsers keep what an earlier view of the job has given them.
    JobView(JobId job, std::uint64_t earlier, std::function<bool(std::uint64_t)> admits);

    // The conversation's thread. A job that is watched again begins anew with Accepted.
    void hear(Instant now, const News& news) override;
    Instant tick(Instant now) override;
    std::optional<Outcome> wants_to_leave() override;
    /// The conversation is over; `again` begins another one.
    void end(const Outcome& outcome);
    void begin_again();

    // Any thread.
    [[nodiscard]] const JobId& job() const { return job_; }
    /// A line of JSON about the job, its revision and where its pictures are.
    [[nodiscard]] Shown shown();
    struct LayerPicture {
        http::Body bytes;
        bool is_asked_for; ///< of the revision that was asked for
    };
    /// As of that revision or later. Errors: not_found, io.
    [[nodiscard]] Result<LayerPicture> layer(Layer layer, std::uint64_t revision);
    /// The pixels of a part, as a .jpg. Errors: not_found, io, and invalid_argument for a part that
    /// is none, or has a side beyond overview_side_max.
    [[nodiscard]] Result<http::Body> part(const PixelRect& part);

    void leave() { leaving_ = true; }
    [[nodiscard]] bool is_leaving() const { return leaving_; }
    /// How the conversation ended; nothing while it goes on.
    [[nodiscard]] std::optional<Outcome> ended() const;
    [[nodiscard]] std::uint64_t pixels() const { return pixels_; }

    /// How many look.
    std::atomic<std::uint32_t> viewers = 0;

private:
    struct Snapshot {
        std::uint64_t revision = 0;
        EncodedOnce overview, costs, workers;
        std::optional<EncodedOnce> pixels = {}; ///< where somebody has asked for them
    };
    void take(const Accepted& news);
    void take(const TileArrived& news);
    void take(const TilesWithdrawn& news);
    void take(const StateChanged& news);
    void take(const ConnectionChanged& news);
    void take(const FarmChanged&) {}
    void take(const Finished&) {}
    void make_snapshot();
    [[nodiscard]] std::string described() const;

    const JobId job_;
    const std::function<bool(std::uint64_t)> admits_;
    std::atomic<bool> leaving_ = false;
    std::atomic<std::uint64_t> pixels_ = 0;
    bool refused_ = false; ///< the conversation's thread's own: the picture has no place

    mutable std::mutex mutex_; // guards all below
    ShownText text_;
    std::optional<protocol::JobState> state_;
    ProgressMeter meter_;
    std::optional<Picture> picture_;
    std::optional<HeatMap> map_;
    HeatMap::Costs scale_; ///< the snapshot's
    std::optional<Outcome> ended_;
    bool connected_ = false, changed_ = false;
    std::uint64_t revision_;
    std::shared_ptr<Snapshot> snapshot_;
    Instant snapshot_due_{};
};

} // namespace fraja::client
