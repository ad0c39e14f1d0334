#include "broker/submission.hpp"

#include "broker/tile_plan.hpp"
#include "common/base/ids.hpp"
#include "common/protocol/cells.hpp"
#include "common/protocol/limits.hpp"
#include "common/protocol/passes.hpp"

#include <algorithm>

namespace fraja::broker {

using namespace protocol;

namespace {

constexpr Duration kept_time_max = std::chrono::hours(24 * 36'500);

bool is_tag(const std::string& tag) {
    return !tag.empty() && tag.size() <= name_bytes_max;
}

std::optional<std::string> fault_of_checks(const SubmitJob& s) {
    const double verify = s.wishes.verify;
    if (!(verify >= 0 && verify <= 1))
        return "the share of tiles to be checked is 0 to 1";
    if (verify > 0 && s.settings.limited_in_time())
        return "a picture with a time limit is not checked: its time is for drawing";
    if (verify > 0 && s.wishes.workers_max == 1)
        return "it takes two workers at least to check tiles";
    return std::nullopt;
}

std::optional<std::string> fault_of_frame(const SubmitJob& s) {
    const Wishes& wishes = s.wishes;
    if ((wishes.film == FilmId{}) != (wishes.frame == 0))
        return wishes.frame == 0 ? "a film's frames count from 1"
                                 : "a picture that is of no film has no number in one";
    if (wishes.film == FilmId{})
        return std::nullopt;
    if (wishes.schedule != Schedule::demand)
        return "a film's frames are dealt out on demand";
    if (s.settings.limited_in_time())
        return "a film's frames have no time limit";
    return std::nullopt;
}

} // namespace

std::uint64_t cell_count(const SubmitJob& s) {
    const std::uint32_t side = s.tile_side > 0 ? s.tile_side : automatic_cell_side(s.settings);
    return cells_of(s.settings.crop, side).pixel_count() * pass_count(s.settings);
}

std::optional<std::string> fault_of(const SubmitJob& s) {
    if (const auto valid = validate(s.settings); !valid)
        return valid.error().message;
    if (s.job == JobId{})
        return "the job's id is zero";
    if (s.job_name.size() > name_bytes_max)
        return "a job's name has at most " + std::to_string(name_bytes_max) + " bytes";
    if (s.scene_bytes == 0 || s.scene_bytes > scene_bytes_max)
        return "a scene has 1 to " + std::to_string(scene_bytes_max) + " bytes";
    if (s.tile_side > tile_side_max)
        return "a tile's side is at most " + std::to_string(tile_side_max) + " pixels";
    if (cell_count(s) > cells_per_job_max)
        return "a job has at most " + std::to_string(cells_per_job_max) + " tiles";
    if (s.wishes.tags.size() > tags_max || !std::ranges::all_of(s.wishes.tags, is_tag))
        return "a job has at most " + std::to_string(tags_max) + " tags of 1 to " +
               std::to_string(name_bytes_max) + " bytes";
    if (s.wishes.schedule != Schedule::demand && s.settings.limited_in_time())
        return "a picture with a time limit is dealt out on demand";
    if (const auto fault = fault_of_checks(s))
        return fault;
    return fault_of_frame(s);
}

std::optional<std::string> fault_of(const StoredJob& job) {
    auto fault = fault_of(job.submission);
    if (!fault && (job.passes == 0 || job.passes > pass_count(job.submission.settings)))
        fault = std::to_string(job.passes) + " passes";
    if (!fault && (job.number == 0 || job.reason.size() > string_bytes_max ||
                   job.elapsed < Duration::zero() || job.elapsed > kept_time_max ||
                   job.age > kept_time_max || job.over_for.value_or(Duration{}) > kept_time_max))
        fault = "its number, its reason or its times";
    return fault;
}

} // namespace fraja::broker
