// Site: where a broker is: its process, and what others reach it by.
#pragma once

#include "tests/sim/network.hpp"
#include "tests/sim/stream.hpp"

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

namespace fraja::sim {

struct Site {
    Site(Farm& farm, std::size_t index)
        : endpoint("tcp://sim" + std::to_string(index) + ":50057"), network(farm, process),
          stream(farm, network, process) {}

    std::string endpoint;
    Process process;
    Network network;
    Stream stream;
};

/// Of all brokers that stand for each other.
using Sites = std::vector<std::unique_ptr<Site>>;

[[nodiscard]] inline std::vector<std::string> endpoints_of(const Sites& sites) {
    std::vector<std::string> all;
    for (const auto& site : sites)
        all.push_back(site->endpoint);
    return all;
}

} // namespace fraja::sim
