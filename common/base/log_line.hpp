// LogLine: what is worth telling whoever runs a program. How it looks, and whether it is told at
// all the hundredth time, is decided elsewhere: common/service.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace fraja {

enum class LogLevel : std::uint8_t { debug, info, warning, error };

struct LogLine {
    LogLevel level = LogLevel::info;
    /// Of event, as "worker_lost": a literal. Of one kind many are counted instead of told; empty:
    /// never, as somebody asked for it.
    std::string_view kind;
    std::string subject; ///< whom it is about, where these are told apart; may be empty
    std::string text;    ///< for people
};

} // namespace fraja
