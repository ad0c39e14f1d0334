// fraja-ctl's command line.
#pragma once

#include "client/options.hpp"

#include <string>
#include <variant>
#include <vector>

namespace fraja::client {

struct ListJobs {};
struct ListWorkers {};
struct ShowJob {
    std::string job;
};
struct CancelJob {
    std::string job;
    bool yes = false; ///< do not ask
};
struct GetPicture {
    std::string job;
    std::string output;
};
using CtlCommand = std::variant<ListJobs, ListWorkers, ShowJob, CancelJob, GetPicture>;

struct CtlOptions {
    SharedOptions shared;
    CtlCommand command;
};

[[nodiscard]] Parsed<CtlOptions> parse_ctl_options(std::vector<std::string> arguments);

} // namespace fraja::client
