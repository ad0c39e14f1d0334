// What the live page's script is told: lines of JSON.
#pragma once

#include "client/page/heat_map.hpp"
#include "client/progress.hpp"
#include "common/protocol/messages.hpp"

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>

namespace fraja::client {

inline constexpr std::size_t page_jobs_max = 100;    ///< listed: those that go on, then the newest
inline constexpr std::size_t page_workers_max = 200; ///< listed: those that work, then by name
inline constexpr std::size_t legend_workers_max = 24;

struct FarmPage {
    protocol::FarmState farm;
    std::map<JobId, ProgressMeter> meters; ///< of each of its jobs
    std::string broker;                    ///< its endpoint
    bool connected = false;
    bool allow_control = false;
    std::string first_job; ///< the one to open; empty: the page's choice
};
/// {"farm":{...}}
[[nodiscard]] std::string farm_line(const FarmPage& page);

struct JobPage {
    JobId job;
    std::string trouble; ///< why it cannot be shown; empty: none
    std::optional<protocol::JobState> state;
    ProgressView progress;
    bool connected = false;
    bool complete = false;      ///< the job is over, and all there is of it is here
    std::uint64_t revision = 0; ///< of its pictures; 0: there is none yet
    std::uint32_t scale = 1;    ///< overview_scale()
    const HeatMap* map = nullptr;
    HeatMap::Costs costs;
};
/// {"job":{...}}
[[nodiscard]] std::string job_line(const JobPage& page);

} // namespace fraja::client
