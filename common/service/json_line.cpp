#include "common/service/json_line.hpp"

#include <fmt/chrono.h>
#include <nlohmann/json.hpp>

namespace fraja::service {

std::string rfc3339(std::chrono::system_clock::time_point time) {
    namespace chrono = std::chrono;
    const auto second = chrono::floor<chrono::seconds>(time);
    return fmt::format("{:%Y-%m-%dT%H:%M:%S}.{:03}Z",
                       fmt::gmtime(chrono::system_clock::to_time_t(second)),
                       chrono::floor<chrono::milliseconds>(time - second).count());
}

std::string_view name_of(LogLevel level) {
    switch (level) {
    case LogLevel::debug:
        return "debug";
    case LogLevel::info:
        return "info";
    case LogLevel::warning:
        return "warning";
    case LogLevel::error:
        break;
    }
    return "error";
}

std::string json_line(std::chrono::system_clock::time_point time, std::string_view program,
                      const Told& told) {
    nlohmann::ordered_json line{{"schema", "fraja.log/1"},
                                {"time", rfc3339(time)},
                                {"level", name_of(told.line.level)},
                                {"program", program}};
    if (!told.line.kind.empty())
        line["event"] = told.line.kind;
    if (!told.line.subject.empty())
        line["subject"] = told.line.subject;
    line["message"] = told.line.text;
    if (told.more > 0)
        line["more"] = told.more;
    using Dump = nlohmann::ordered_json;
    return line.dump(-1, ' ', /*ensure_ascii=*/true, Dump::error_handler_t::replace);
}

} // namespace fraja::service
