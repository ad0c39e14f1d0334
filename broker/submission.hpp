// What a submission must be, whoever sends it and wherever it was kept.
#pragma once

#include "broker/contents.hpp"
#include "common/protocol/messages.hpp"

#include <cstdint>
#include <optional>
#include <string>

namespace fraja::broker {

/// Tiles of all its passes, as the wire counts them.
[[nodiscard]] std::uint64_t cell_count(const protocol::SubmitJob& submission);

/// Why no broker takes it, whatever else it has; nothing: it makes sense.
[[nodiscard]] std::optional<std::string> fault_of(const protocol::SubmitJob& submission);

/// Why it cannot have been kept like that.
[[nodiscard]] std::optional<std::string> fault_of(const StoredJob& job);

} // namespace fraja::broker
