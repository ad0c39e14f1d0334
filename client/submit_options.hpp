// fraja-submit's command line.
#pragma once

#include "client/frames.hpp"
#include "client/options.hpp"
#include "common/base/text.hpp"
#include "common/protocol/messages.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace fraja::client {

struct SubmitOptions {
    SharedOptions shared;
    std::string scene_file;
    std::string output;
    PictureEncoding encoding; ///< of the output
    std::string job_name;
    std::string travel_file; ///< of a film: its cameras; then `output` is a pattern for its frames
    std::optional<FrameRange> frames; ///< of these; none: all
    protocol::PictureSettings settings;
    std::uint32_t tile_side = 0; ///< 0: the broker chooses
    protocol::TileOrder order = protocol::TileOrder::automatic;
    std::int32_t priority = 0;
    protocol::Wishes wishes;
    bool local = false;
    std::uint32_t local_threads = 0; ///< 0: every CPU this process may use
    std::vector<std::string> direct; ///< workers that listen, called in place of a broker
    bool resume = false;             ///< take over a job of the same scene and settings
    bool detach = false, wait = false, dry_run = false, stats = false;
    bool skip_existing = false;
    PreviewMode preview = PreviewMode::none;
    std::optional<Duration> timeout;

    /// Whether the job is this process's own, and ends with it.
    [[nodiscard]] bool own_farm() const { return local || !direct.empty(); }
    /// Who would take it; empty: nobody.
    [[nodiscard]] std::string brokers_asked() const {
        return own_farm() ? std::string() : comma_list(shared.brokers);
    }
};

/// Everything that can be checked without looking at a file or a broker is checked.
[[nodiscard]] Parsed<SubmitOptions> parse_submit_options(std::vector<std::string> arguments);

/// For people: who would be asked, or who draws without a broker.
[[nodiscard]] std::string broker_text(const SubmitOptions& options);

/// What to do where no worker is at the job, or whom it waits for.
[[nodiscard]] std::string worker_cure(const SubmitOptions& options, const std::string& broker);

/// Why a job with --direct is given up, for people.
[[nodiscard]] std::string why_no_worker(const SubmitOptions& options);

/// What is wanted, as a new job.
[[nodiscard]] protocol::SubmitJob new_job(const SubmitOptions& options, std::string name,
                                          const ContentHash& scene, std::uint64_t scene_bytes);

} // namespace fraja::client
