// restore: what a broker finds again in its store, checked for what SQLite knows nothing of.
#pragma once

#include "broker/events.hpp"
#include "broker/store.hpp"
#include "broker/store_reader.hpp"
#include "common/base/result.hpp"

namespace fraja::broker {

/// The contents, with the scenes of the jobs that are not over. Errors, of code io: it cannot be
/// read, or no broker can have written it; nothing has been changed.
[[nodiscard]] Result<Restored> restore(const Store& store, StoreReader& reader);

/// Reads what restore() leaves for later, every pixel and every scene, and compares it with its
/// hash. Errors as above.
[[nodiscard]] Result<void> check_bytes(const Contents& contents, StoreReader& reader);

} // namespace fraja::broker
