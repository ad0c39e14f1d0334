// Asking the DNS for SRV records, with c-ares: the only code that does, beside the parsing of srv.
#pragma once

#include "common/base/instant.hpp"
#include "common/discovery/srv.hpp"
#include "common/net/tcp.hpp"

#include <chrono>
#include <string>
#include <vector>

namespace fraja::discovery {

struct DnsOptions {
    /// ADDRESS:PORT, several separated by commas; empty: those that the system is told of.
    std::string servers = {};
    Duration timeout = std::chrono::seconds(2); ///< of the first try; then longer
    int tries = 2;                              ///< of each server
};

/// The records of that name. An answer that is too long for UDP is asked for again by TCP. Blocks.
/// Errors, saying what hinders: not_found (no such name, no such records), unreachable (no server
/// answers, or answers but with an error), malformed_frame, cancelled, io.
[[nodiscard]] Result<std::vector<SrvRecord>>
look_up_srv(const std::string& name, const DnsOptions& options, const net::Interrupt& interrupt);

} // namespace fraja::discovery
