#include "common/service/logger.hpp"

#include "common/net/clock.hpp"
#include "common/service/color.hpp"
#include "common/service/journal.hpp"
#include "common/service/json_line.hpp"

#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <string_view>
#include <unistd.h>
#include <utility>

namespace fraja::service {
namespace {

spdlog::level::level_enum to_spdlog(LogLevel level) {
    switch (level) {
    case LogLevel::debug:
        return spdlog::level::debug;
    case LogLevel::info:
        return spdlog::level::info;
    case LogLevel::warning:
        return spdlog::level::warn;
    case LogLevel::error:
        break;
    }
    return spdlog::level::err;
}

} // namespace

Logger::Logger(std::string program, const LogOptions& options)
    : program_(std::move(program)), as_json_(options.as_json()),
      to_journal_(goes_to_journal(STDERR_FILENO)) {
    auto sink = std::make_shared<spdlog::sinks::stderr_color_sink_mt>(
        wants_color(options.color_choice(), STDERR_FILENO) ? spdlog::color_mode::always
                                                           : spdlog::color_mode::never);
    logger_ = std::make_shared<spdlog::logger>(program_, std::move(sink));
    logger_->set_pattern(as_json_ || to_journal_ ? "%v" : "%Y-%m-%d %H:%M:%S.%e %n %^%l%$ %v");
    set_level(options.least());
}

Logger::~Logger() {
    for (const Told& told : repeats_.rest())
        write(told);
}

void Logger::set_level(LogLevel least) {
    logger_->set_level(to_spdlog(least));
}

void Logger::log(LogLine line) {
    if (!logger_->should_log(to_spdlog(line.level)))
        return;
    const std::lock_guard lock(mutex_);
    if (const auto told = repeats_.take(net::now(), std::move(line)))
        write(*told);
}

void Logger::tell_due() {
    const std::lock_guard lock(mutex_);
    for (const Told& told : repeats_.due(net::now()))
        write(told);
}

void Logger::write(const Told& told) {
    const auto level = to_spdlog(told.line.level);
    const std::string_view prefix = to_journal_ ? journal_prefix(told.line.level) : "";
    if (as_json_)
        logger_->log(level, "{}{}", prefix,
                     json_line(std::chrono::system_clock::now(), program_, told));
    else if (told.more > 0)
        logger_->log(level, "{}{} (and {} more like it)", prefix, told.line.text, told.more);
    else
        logger_->log(level, "{}{}", prefix, told.line.text);
}

} // namespace fraja::service
