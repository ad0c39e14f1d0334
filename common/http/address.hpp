// Where a server listens.
#pragma once

#include "common/base/result.hpp"
#include "common/net/endpoint.hpp"

#include <cstdint>
#include <string>

namespace fraja::http {

struct Address {
    std::string host;       ///< as a socket binds it: an IPv6 address without brackets
    std::uint16_t port = 0; ///< 0: the system chooses
    friend bool operator==(const Address&, const Address&) = default;
};

inline constexpr const char* every_interface = "0.0.0.0";

/// Of a tcp endpoint (asserted); its host * is every interface.
[[nodiscard]] Address address_of(const net::Endpoint& endpoint);

/// "http://127.0.0.1:80", "http://[::1]:80".
[[nodiscard]] std::string to_string(const Address& address);

/// A socket that listens, for its owner to close, and its address with the port that it is.
struct Listener {
    int fd = -1;
    Address address;
};
/// Two servers never share a port. Errors: io, naming the address and the cure.
[[nodiscard]] Result<Listener> listen_at(const Address& address);

} // namespace fraja::http
