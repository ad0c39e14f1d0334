// Endpoints: where sockets bind and connect.
#pragma once

#include "common/base/result.hpp"

#include <cstdint>
#include <string>
#include <string_view>

namespace fraja::net {

/// Where brokers listen for workers and clients, unless told otherwise.
constexpr std::uint16_t broker_port = 50057, stream_port = 50058, http_port = 50059;
constexpr const char* default_broker = "tcp://127.0.0.1:50057";
constexpr const char* default_stream = "tcp://127.0.0.1:50058";

/// tcp://HOST:PORT, ipc://PATH or inproc://NAME. Other transports that a build of libzmq may know
/// are refused.
struct Endpoint {
    enum class Transport : std::uint8_t { tcp, ipc, inproc };
    Transport transport = Transport::tcp;
    std::string host; ///< of tcp; an IPv6 address keeps its brackets; "*" binds to every interface
    std::uint16_t port = 0; ///< of tcp; 0: the system chooses
    std::string path;       ///< of ipc and inproc
    friend bool operator==(const Endpoint&, const Endpoint&) = default;
};

/// "HOST:PORT" and "HOST" (then `default_port`) are read as tcp. The error says what is wrong with
/// which part.
[[nodiscard]] Result<Endpoint> parse_endpoint(std::string_view text, std::uint16_t default_port);
[[nodiscard]] std::string to_string(const Endpoint& endpoint);

/// Of an endpoint's host: brackets are an endpoint's, not an address's.
[[nodiscard]] std::string without_brackets(const std::string& host);

/// Whether only this machine can reach it: 127.0.0.0/8, ::1, localhost, ipc, inproc.
[[nodiscard]] bool is_loopback(const Endpoint& endpoint);

/// An endpoint as a socket binds it. Unless it is `open_to_all`, having keys or on somebody's word,
/// one that other machines can reach is refused.
[[nodiscard]] Result<std::string> endpoint_to_bind(std::string_view text,
                                                   std::uint16_t default_port, bool open_to_all);

/// An endpoint as a socket connects to it. One that is only good to listen at (host *, port 0) or
/// that does not leave this process is refused.
[[nodiscard]] Result<std::string> endpoint_to_connect(std::string_view text,
                                                      std::uint16_t default_port);

/// Where a peer finds the stream: it reached the broker at `reached`, and was told that the stream
/// is at `told`. For tcp that is the host it reached with the port it was told; otherwise what it
/// was told.
[[nodiscard]] Result<std::string> stream_endpoint(std::string_view reached, std::string_view told);

} // namespace fraja::net
