#include "common/discovery/beacon.hpp"

#include "common/base/bytes.hpp"
#include "common/net/endpoint.hpp"
#include "common/protocol/content_hash.hpp"

#include <algorithm>
#include <string_view>

namespace fraja::discovery {
namespace {

constexpr std::string_view magic = "FRAJ";
constexpr std::size_t version_at = 4, flags_at = 5, port_at = 6, farm_at = 8, host_at = 24;
constexpr std::byte has_keys{1};
static_assert(host_at + beacon_host_bytes_max == beacon_bytes);

net::Endpoint endpoint(std::string host, std::uint16_t port) {
    return {.transport = net::Endpoint::Transport::tcp,
            .host = std::move(host),
            .port = port,
            .path = {}};
}

/// Empty stands for the sender.
bool is_host(const std::string& host, std::uint16_t port) {
    if (host.empty())
        return true;
    const net::Endpoint meant = endpoint(host, port);
    const auto read = net::parse_endpoint(net::to_string(meant), 0);
    return read && *read == meant && net::endpoint_to_connect(net::to_string(meant), 0);
}

bool is_zero(std::byte b) {
    return b == std::byte{0};
}

Error malformed(const char* why) {
    return {ErrorCode::malformed_frame, why};
}

} // namespace

Fingerprint fingerprint_of(const net::PublicKey& farm) {
    const auto hash = protocol::content_hash(to_bytes("fraja farm " + farm.text));
    Fingerprint fingerprint{};
    std::ranges::copy(std::as_bytes(std::span(hash.bytes).first(fingerprint.size())),
                      fingerprint.begin());
    return fingerprint;
}

std::array<std::byte, beacon_bytes> encode_beacon(const Beacon& beacon) {
    FRAJA_ASSERT(beacon.port != 0 && beacon.host.size() <= beacon_host_bytes_max);
    FRAJA_ASSERT(is_host(beacon.host, beacon.port));
    std::array<std::byte, beacon_bytes> bytes{};
    std::ranges::copy(to_bytes(magic), bytes.begin());
    bytes[version_at] = std::byte{beacon_version};
    bytes[port_at] = static_cast<std::byte>(beacon.port >> 8);
    bytes[port_at + 1] = static_cast<std::byte>(beacon.port & 0xff);
    if (beacon.farm) {
        bytes[flags_at] = has_keys;
        std::ranges::copy(*beacon.farm, bytes.begin() + farm_at);
    }
    std::ranges::copy(to_bytes(beacon.host), bytes.begin() + host_at);
    return bytes;
}

Result<Beacon> decode_beacon(std::span<const std::byte> bytes) {
    if (bytes.size() <= version_at || as_text(bytes.first(magic.size())) != magic)
        return malformed("no beacon");
    if (bytes[version_at] != std::byte{beacon_version})
        return Error{ErrorCode::version_mismatch, "a beacon of another version"};
    if (bytes.size() != beacon_bytes)
        return malformed("another length");
    Beacon beacon;
    beacon.port = static_cast<std::uint16_t>((static_cast<unsigned>(bytes[port_at]) << 8) |
                                             static_cast<unsigned>(bytes[port_at + 1]));
    if (beacon.port == 0)
        return malformed("no port");
    Fingerprint farm{};
    std::ranges::copy(bytes.subspan(farm_at, farm.size()), farm.begin());
    if ((bytes[flags_at] & has_keys) == has_keys)
        beacon.farm = farm;
    else if (!std::ranges::all_of(farm, is_zero))
        return malformed("a farm without keys");
    const auto field = bytes.subspan(host_at);
    const auto end = std::ranges::find_if(field, is_zero);
    if (!std::all_of(end, field.end(), is_zero))
        return malformed("bytes behind the host");
    beacon.host = as_text(field.first(static_cast<std::size_t>(end - field.begin())));
    if (!is_host(beacon.host, beacon.port))
        return malformed("no host");
    return beacon;
}

std::string endpoint_of(const Beacon& beacon, const std::string& sender) {
    return net::to_string(endpoint(beacon.host.empty() ? sender : beacon.host, beacon.port));
}

} // namespace fraja::discovery
