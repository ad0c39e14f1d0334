// A network for a test, or the words by which ctest counts it as skipped.
#pragma once

#include "tests/support/network.hpp"

#include <cstddef>
#include <cstdlib>
#include <doctest/doctest.h>
#include <optional>
#include <string>
#include <utility>

namespace fraja {

/// Nothing where namespaces are not permitted: the test has nothing more to do then, and ctest
/// counts it among those that did not run. In CI it fails.
[[nodiscard]] inline std::optional<TestNetwork> network_or_skip(std::size_t hosts) {
    auto network = TestNetwork::make(hosts);
    if (network)
        return *std::move(network);
    REQUIRE_MESSAGE(std::getenv("CI") == nullptr, // its machines permit them
                    "no network of its own: " << network.error().message);
    MESSAGE(std::string(skipped_words)
            << network.error().message); // doctest shows a pointer as such
    return std::nullopt;
}

} // namespace fraja
