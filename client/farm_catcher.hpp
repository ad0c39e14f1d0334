// Hears the farm's state once, and has had enough.
#pragma once

#include "client/shell.hpp"

#include <optional>

namespace fraja::client {

class FarmCatcher final : public Listener {
public:
    void hear(Instant, const News& news) override {
        if (const auto* changed = std::get_if<FarmChanged>(&news); changed && !farm)
            farm = changed->farm;
    }
    std::optional<Outcome> wants_to_leave() override {
        return farm ? std::optional(Outcome{}) : std::nullopt;
    }
    std::optional<protocol::FarmState> farm;
};

} // namespace fraja::client
