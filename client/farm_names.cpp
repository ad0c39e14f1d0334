#include "client/farm_names.hpp"

#include "client/farm_catcher.hpp"
#include "client/json.hpp"
#include "client/shell.hpp"
#include "client/watching.hpp"
#include "common/base/text.hpp"

#include <algorithm>
#include <set>

namespace fraja::client {
namespace {

std::vector<cli::Candidate> names_of(const std::vector<protocol::JobState>& jobs, bool ids) {
    std::vector<cli::Candidate> names;
    std::set<std::string> known; // a name is its newest job's
    for (const protocol::JobState& job : jobs) {
        const std::string what = job.job_name + " #" + std::to_string(job.number) + " is " +
                                 std::string(to_string(job.phase));
        if (known.insert(job.job_name).second)
            names.push_back({job.job_name, what});
        if (ids)
            names.push_back({to_string(job.job), what});
    }
    return names;
}

std::vector<cli::Candidate> names_of(const std::vector<protocol::WorkerState>& workers, bool ids) {
    std::vector<cli::Candidate> names;
    for (const protocol::WorkerState& worker : workers) {
        names.push_back({worker.worker_name, "a worker of " + counted(worker.threads, "thread")});
        if (ids)
            names.push_back({to_string(worker.worker), worker.worker_name});
    }
    return names;
}

} // namespace

std::vector<cli::Candidate> farm_names(const SharedOptions& shared, std::string_view value,
                                       std::string_view begun) {
    if (value != "JOB" && value != "WORKER")
        return {};
    SharedOptions soon = shared;
    soon.connect_timeout = names_timeout;
    const net::Context context(shared.keys);
    FarmCatcher catcher;
    FarmWatching watching(session_options(soon));
    (void)converse(context, watching, catcher, nullptr);
    if (!catcher.farm)
        return {};
    return value == "JOB" ? names_of(catcher.farm->jobs, !begun.empty())
                          : names_of(catcher.farm->workers, !begun.empty());
}

std::string meant_in_farm(const SharedOptions& shared, std::string_view value,
                          std::string_view name) {
    const auto known = farm_names(shared, value, name);
    std::vector<std::string_view> names;
    for (const cli::Candidate& candidate : known)
        names.push_back(candidate.word);
    return did_you_mean(meant_name(name, names));
}

cli::NameSource farm_name_source(const SharedArguments& shared) {
    return [&shared](std::string_view value, std::string_view begun) {
        const auto options = shared.read();
        return options ? farm_names(*options, value, begun) : std::vector<cli::Candidate>();
    };
}

} // namespace fraja::client
