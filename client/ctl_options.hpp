// fraja-ctl's command line.
#pragma once

#include "client/options.hpp"
#include "common/protocol/messages.hpp"

#include <cstdint>
#include <string>
#include <variant>
#include <vector>

namespace fraja::client {

struct ListJobs {};
struct ListWorkers {};
struct ShowJob {
    std::string job;
};
struct ControlJob {
    std::string job;
    protocol::JobDeed deed{};
    std::int32_t priority = 0;
    bool yes = false; ///< do not ask
};
struct ControlWorker {
    std::string worker;
    protocol::WorkerDeed deed{};
    bool yes = false; ///< do not ask
};
struct GetPicture {
    std::string job;
    std::string output;
    PictureEncoding encoding;
};
struct ListBrokers {};
struct ShowStats {};
/// A new key pair.
struct MakeKey {
    std::string output;
};
/// What is wrong here?
struct Examine {
    /// What any other command would end with, as the settings files are; they are not in use then.
    std::string refused_over;
};
using CtlCommand = std::variant<ListJobs, ListWorkers, ShowJob, ControlJob, ControlWorker,
                                GetPicture, ListBrokers, ShowStats, MakeKey, Examine>;

struct CtlOptions {
    SharedOptions shared;
    std::string broker_key; ///< as it was typed or set; of MakeKey
    CtlCommand command;
};

[[nodiscard]] Parsed<CtlOptions> parse_ctl_options(std::vector<std::string> arguments);

} // namespace fraja::client
