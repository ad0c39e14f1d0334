// Metrics: a broker's numbers as Prometheus reads them.
#pragma once

#include "broker/report.hpp"
#include "broker/surroundings.hpp"

#include <optional>
#include <string>

namespace fraja::broker {

inline constexpr const char* metrics_content_type = "text/plain; version=0.0.4; charset=utf-8";

struct MetricSources {
    const Report* report = nullptr; ///< null: there was none yet, and only the process is known
    ProcessUsage process;
    std::optional<StoreUsage> store;
};

/// In Prometheus's text format. Labels have the values that the code names: nothing that a peer or
/// a person has said is one, so there are as many time series for a thousand workers as for one.
[[nodiscard]] std::string metrics_text(const MetricSources& sources);

} // namespace fraja::broker
