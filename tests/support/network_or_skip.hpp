// A network for a test, or the words by which ctest counts it as skipped.
#pragma once

#include "tests/support/network.hpp"

#include <cstddef>
#include <doctest/doctest.h>
#include <optional>
#include <utility>

namespace fraja {

/// Nothing where namespaces are not permitted: the test has nothing more to do then.
[[nodiscard]] inline std::optional<TestNetwork> network_or_skip(std::size_t hosts) {
    auto network = TestNetwork::make(hosts);
    if (network)
        return *std::move(network);
    MESSAGE(skipped_words << network.error().message);
    return std::nullopt;
}

} // namespace fraja
