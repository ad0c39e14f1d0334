// The farm as people see it: in a terminal's window, or line by line.
#pragma once

#include "client/preview/fit.hpp"
#include "common/protocol/messages.hpp"

#include <string>
#include <vector>

namespace fraja::client {

/// What is known of the farm at the moment.
struct FarmView {
    std::string broker; ///< where it was reached
    bool connected = false;
    bool known = false; ///< `farm` has come
    protocol::FarmState farm;
};

/// The tables of broker, jobs and workers, whole; the farm must be known.
[[nodiscard]] std::string farm_page(const FarmView& view);

/// At most as many lines as the window has, none wider. Where there is no room for all jobs, those
/// that are not over are shown before others, the newest first; what is left out is counted.
[[nodiscard]] std::vector<std::string> farm_screen(const FarmView& view, const Window& window);

} // namespace fraja::client
