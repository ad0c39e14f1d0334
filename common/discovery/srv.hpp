// SRV records (RFC 2782): what an answer of the DNS says, and in which order it is to be tried.
#pragma once

#include "common/base/result.hpp"
#include "common/base/rng.hpp"

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace fraja::discovery {

/// Of one name; of more of them, the last in order are not tried.
inline constexpr std::size_t srv_records_max = 64;

struct SrvRecord {
    std::uint16_t priority = 0, weight = 0, port = 0;
    std::string target; ///< a host's name
    friend bool operator==(const SrvRecord&, const SrvRecord&) = default;
};

/// Of an answer as it comes from the wire; in its order. Errors: malformed_frame; not_found: it has
/// no such records, or one that says that there is decidedly no such service (a target of `.`).
[[nodiscard]] Result<std::vector<SrvRecord>> parse_srv_answer(std::span<const std::byte> answer);

/// Endpoints, in the order in which they are to be tried: by priority, and among equals at random,
/// by weight. Records that lead nowhere (port 0, a target that is no host) are left out.
[[nodiscard]] std::vector<std::string> endpoints_in_order(std::vector<SrvRecord> records, Rng& rng);

} // namespace fraja::discovery
