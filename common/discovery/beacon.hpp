// Beacon: the datagram by which a broker announces itself. Anybody can send one, and say anything:
// it tells where a broker may be, never who it is. With keys that is proved by CURVE's handshake,
// as for every endpoint.
//
//   offset  size
//   0       4     "FRAJ"
//   4       1     beacon_version
//   5       1     flags: 1, the broker has keys; others are 0 and not looked at
//   6       2     port, big endian, not 0
//   8       16    with keys: fingerprint of the farm's public key; else 0
//   24      64    host, filled up with 0; all 0: the address that the datagram comes from
#pragma once

#include "common/base/result.hpp"
#include "common/net/keys.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

namespace fraja::discovery {

/// UDP, where announcements are heard; the number of the broker's TCP port.
inline constexpr std::uint16_t beacon_port = 50057;
inline constexpr std::uint8_t beacon_version = 1;
inline constexpr std::size_t beacon_bytes = 88;
inline constexpr std::size_t beacon_host_bytes_max = 64;

/// By which friends know their farm; who hears it cannot begin a handshake, as with the key itself.
using Fingerprint = std::array<std::byte, 16>;
[[nodiscard]] Fingerprint fingerprint_of(const net::PublicKey& farm);

struct Beacon {
    std::uint16_t port = 0;
    std::optional<Fingerprint> farm = {}; ///< nothing: the broker has no keys
    std::string host = {};                ///< as Endpoint's; empty: the sender's address
    friend bool operator==(const Beacon&, const Beacon&) = default;
};

/// The beacon must be one that decode_beacon() would take (asserted).
[[nodiscard]] std::array<std::byte, beacon_bytes> encode_beacon(const Beacon& beacon);
/// Errors: malformed_frame; version_mismatch: a beacon of another version. They quote nothing.
[[nodiscard]] Result<Beacon> decode_beacon(std::span<const std::byte> bytes);

/// As sockets connect to it; `sender` as Endpoint's host.
[[nodiscard]] std::string endpoint_of(const Beacon& beacon, const std::string& sender);

} // namespace fraja::discovery
