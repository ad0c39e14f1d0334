// The JSON objects that programs print for other programs: one line each, schemas as in CLI.md.
#pragma once

#include "client/doctor.hpp"
#include "client/exit_code.hpp"
#include "client/film_progress.hpp"
#include "client/picture.hpp"
#include "client/progress.hpp"
#include "client/table.hpp"
#include "common/protocol/messages.hpp"

#include <chrono>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace fraja::client {

/// fraja.tile/1: a finished tile.
[[nodiscard]] std::string tile_json(const protocol::TileDone& tile);
/// fraja.job/1: a job as it is.
[[nodiscard]] std::string job_json(const protocol::JobState& state);
/// fraja.worker/1
[[nodiscard]] std::string worker_json(const protocol::WorkerState& state);
/// fraja.broker/1: a broker and what it has done, with the endpoint where it was asked.
[[nodiscard]] std::string broker_json(const AskedBroker& asked);
/// fraja.broker/1 without it: what a farm has done since its broker started.
[[nodiscard]] std::string stats_json(const protocol::FarmState& farm);
/// fraja.finding/1: what a doctor found.
/// Of a new key pair; the secret is in the file alone.
[[nodiscard]] std::string key_json(const std::string& file, const std::string& public_key);
[[nodiscard]] std::string finding_json(const Finding& finding);
/// fraja.farm/1: the broker, all jobs and workers.
[[nodiscard]] std::string farm_json(const protocol::FarmState& farm);
/// fraja.progress/1
[[nodiscard]] std::string progress_json(const ProgressView& view);
/// fraja.film_progress/1
[[nodiscard]] std::string film_progress_json(const FilmView& view);

/// fraja.event/1: something that happened once, beside the progress.
[[nodiscard]] std::string event_json(std::string_view event, std::string_view text);

/// What is known of a submission when it is over.
struct SubmissionReport {
    std::string state; ///< a phase, "accepted" of a detached job, "dry_run", "skipped"
    Outcome outcome;
    std::string job_name, scene_file;
    protocol::JobState job; ///< zero where none was acknowledged
    protocol::PictureSettings settings;
    ContentHash scene;
    std::string output;                ///< that was written, or would be in a dry run; empty: none
    std::optional<std::string> broker; ///< who would be asked in a dry run; empty: nobody
    std::optional<Estimate> estimate;
    std::size_t workers = 0;   ///< that rendered at least one tile
    Duration processor_time{}; ///< of this process, from the submission on
    std::chrono::system_clock::time_point started, finished;
};
/// fraja.submit/1
[[nodiscard]] std::string submit_json(const SubmissionReport& report);

/// What is known of a film when it is over, or left.
struct FilmReport {
    struct Frame {
        std::uint32_t number = 0;
        std::string state = "not_submitted"; ///< a phase, or "skipped"
        std::string reason, output;          ///< empty: none; output as of a picture
        protocol::JobState job;              ///< zero where none was acknowledged
    };
    Outcome outcome;
    FilmId film;
    std::string job_name, scene_file, travel_file;
    protocol::PictureSettings settings;
    std::vector<Frame> frames;
    std::optional<std::string> broker; ///< as of a picture
    std::chrono::system_clock::time_point started, finished;
};
/// fraja.film/1
[[nodiscard]] std::string film_json(const FilmReport& report);

[[nodiscard]] std::string_view to_string(protocol::JobPhase phase);

} // namespace fraja::client
