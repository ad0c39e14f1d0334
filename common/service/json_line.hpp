// json_line: an event as one line of JSON, for programs that read logs.
#pragma once

#include "common/service/repeats.hpp"

#include <chrono>
#include <string>
#include <string_view>

namespace fraja::service {

/// {"schema":"fraja.log/1","time":...,"level":...,"program":...,"event":...,"subject":...,
/// "message":...,"more":...} without the newline; what is empty or 0 is left out. The time is RFC
/// 3339 UTC. Valid JSON in ASCII whatever the texts hold: bytes that are no UTF-8 become U+FFFD.
[[nodiscard]] std::string json_line(std::chrono::system_clock::time_point time,
                                    std::string_view program, const Told& told);

/// "2025-11-22T21:41:16.123Z"
[[nodiscard]] std::string rfc3339(std::chrono::system_clock::time_point time);

/// As people and JSON read it.
[[nodiscard]] std::string_view name_of(LogLevel level);

} // namespace fraja::service
