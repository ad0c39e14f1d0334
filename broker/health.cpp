#include "broker/health.hpp"

#include "common/base/text.hpp"

#include <nlohmann/json.hpp>

namespace fraja::broker {

Health liveness_of(const Report* latest, Instant now) {
    if (!latest)
        return {true, ""};
    if (const Duration silence = now - latest->at; silence > loop_patience)
        return {false, "the broker's loop has not turned for " + format_duration(silence)};
    return {true, ""};
}

Health health_of(const Report* latest, Instant now) {
    if (!latest)
        return {false, "the broker is starting"};
    if (Health alive = liveness_of(latest, now); !alive.is_well)
        return alive;
    if (const std::string& trouble = latest->figures.store_trouble; !trouble.empty())
        return {false, "nothing can be kept, so nothing is handed out: " + trouble};
    return {true, ""};
}

std::string to_json(const Health& health) {
    nlohmann::ordered_json object{{"schema", "fraja.health/1"},
                                  {"status", health.is_well ? "ok" : "failing"}};
    if (!health.is_well)
        object["reason"] = health.reason;
    return object.dump(-1, ' ', true, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

} // namespace fraja::broker
