// Report: all that a running broker knows of itself in numbers.
#pragma once

#include "broker/figures.hpp"
#include "broker/store_writer.hpp"
#include "common/base/instant.hpp"

#include <cstdint>
#include <optional>

namespace fraja::broker {

struct Report {
    Instant at; ///< by net::now()
    Figures figures;
    // Of messages, without what transports add:
    std::uint64_t received_bytes = 0, sent_bytes = 0;
    std::uint64_t published_bytes = 0;     ///< once, however many subscribe
    std::uint64_t keys_refused = 0;        ///< handshakes
    std::uint64_t keys_missing = 0;        ///< likewise, that ended before one was shown
    std::optional<WriterTotals> written{}; ///< nothing: nothing is kept
};

} // namespace fraja::broker
