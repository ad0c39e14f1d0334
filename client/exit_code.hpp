// How a client's program ends. Users script against these numbers: they are CLI.md's.
#pragma once

#include <string>

namespace fraja::client {

enum class ExitCode : int {
    done = 0,
    job_failed = 1,
    usage = 2,       ///< options, configuration or scene; nothing was submitted
    unreachable = 3, ///< no broker within --connect-timeout
    refused = 4,     ///< key, role or protocol version
    cancelled = 5,   ///< the job was
    no_such_job = 6,
    timed_out = 124, ///< the job goes on
    interrupted = 130,
    terminated = 143,
};

struct Outcome {
    ExitCode code = ExitCode::done;
    std::string reason; ///< for a person; empty when all went well
    friend bool operator==(const Outcome&, const Outcome&) = default;
};

} // namespace fraja::client
