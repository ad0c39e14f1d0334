// Names of jobs and workers, for whoever presses TAB.
#pragma once

#include "client/options.hpp"
#include "common/cli/completion.hpp"

namespace fraja::client {

/// How long a key may wait for a broker.
inline constexpr Duration names_timeout = std::chrono::milliseconds(500);

/// Of the farm whose broker `shared` names: for "JOB" and "WORKER" names that begin with `begun`,
/// and where something is typed the ids that do. None where no broker answers soon.
[[nodiscard]] std::vector<cli::Candidate>
farm_names(const SharedOptions& shared, std::string_view value, std::string_view begun);

/// " (did you mean 'cone'?)" where one of farm_names() was probably meant by `name`; or nothing.
[[nodiscard]] std::string meant_in_farm(const SharedOptions& shared, std::string_view value,
                                        std::string_view name);

/// farm_names() as the shared arguments name the broker when it is asked for. They must outlive it.
[[nodiscard]] cli::NameSource farm_name_source(const SharedArguments& shared);

} // namespace fraja::client
