// Logger: the log of a program that runs for long, on stderr: one line for each event, as text or
// JSON, and no floods. In systemd's journal, which has time, program and level itself, a line is
// its text.
#pragma once

#include "common/base/log_line.hpp"
#include "common/service/log_options.hpp"
#include "common/service/repeats.hpp"

#include <memory>
#include <mutex>
#include <string>

namespace spdlog {
class logger;
}

namespace fraja::service {

/// Any thread may use it.
class Logger {
public:
    Logger(std::string program, const LogOptions& options);
    /// Tells what was only counted.
    ~Logger();
    Logger(const Logger&) = delete;
    Logger& operator=(const Logger&) = delete;

    void log(LogLine line);
    /// What is told at least.
    void set_level(LogLevel least);
    /// To be called about once a second: what was counted is told in its time.
    void tell_due();

private:
    void write(const Told& told);

    std::string program_;
    bool as_json_, to_journal_;
    std::shared_ptr<spdlog::logger> logger_;
    std::mutex mutex_; ///< of what follows
    Repeats repeats_;
};

} // namespace fraja::service
