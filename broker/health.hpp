// Health: whether a broker does what it is there for.
#pragma once

#include "broker/report.hpp"
#include "common/base/instant.hpp"

#include <chrono>
#include <string>

namespace fraja::broker {

/// A loop that has not turned for so long hangs.
inline constexpr Duration loop_patience = std::chrono::seconds(5);

struct Health {
    bool is_well = false;
    std::string reason; ///< why not; empty: it is well
    friend bool operator==(const Health&, const Health&) = default;
};

/// `latest`, the last report, may be null: there was none yet. A broker is well whose loop turns
/// and that can keep what it is given.
[[nodiscard]] Health health_of(const Report* latest, Instant now);

/// Whether it should be started again when it is not well: that its disk is full does not pass by
/// that, nor that it still reads its store.
[[nodiscard]] Health liveness_of(const Report* latest, Instant now);

/// {"schema":"fraja.health/1","status":"ok"} or "status":"failing" with the reason, and a newline.
[[nodiscard]] std::string to_json(const Health& health);

} // namespace fraja::broker
