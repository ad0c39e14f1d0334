#include "common/net/endpoint.hpp"

#include "common/base/text.hpp"

#include <algorithm>

namespace fraja::net {
namespace {

constexpr std::size_t path_bytes_max = 100; // of ipc: sockaddr_un holds 108

Error invalid(std::string_view text, const std::string& why) {
    return {ErrorCode::invalid_argument, "endpoint '" + std::string(text) + "': " + why};
}

Result<Endpoint> parse_tcp(std::string_view whole, std::string_view rest,
                           std::uint16_t default_port) {
    Endpoint endpoint;
    endpoint.port = default_port;
    const std::size_t bracket = rest.starts_with('[') ? rest.find(']') : 0;
    if (bracket == std::string_view::npos)
        return invalid(whole, "an IPv6 address needs its closing ']'");
    const std::size_t colon = rest.find(':', bracket);
    endpoint.host = rest.substr(0, colon);
    if (endpoint.host.empty())
        return invalid(whole, "a host is missing (as in tcp://127.0.0.1:50057)");
    const auto fits = [](char c) {
        return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
               std::string_view(".-_*[]:%").find(c) != std::string_view::npos;
    };
    if (!std::ranges::all_of(endpoint.host, fits))
        return invalid(whole, "'" + endpoint.host + "' is no host");
    if (colon != std::string_view::npos) {
        const auto port = parse_count(rest.substr(colon + 1));
        if (!port || *port > UINT16_MAX)
            return invalid(whole, "a port is a number from 0 to 65535");
        endpoint.port = static_cast<std::uint16_t>(*port);
    }
    return endpoint;
}

} // namespace

Result<Endpoint> parse_endpoint(std::string_view text, std::uint16_t default_port) {
    const std::size_t scheme_end = text.find("://");
    if (scheme_end == std::string_view::npos)
        return parse_tcp(text, text, default_port);
    const std::string_view scheme = text.substr(0, scheme_end), rest = text.substr(scheme_end + 3);
    if (scheme == "tcp")
        return parse_tcp(text, rest, default_port);
    if (scheme != "ipc" && scheme != "inproc")
        return invalid(text, "the transport is tcp, ipc or inproc");
    if (rest.empty() || rest.size() > path_bytes_max)
        return invalid(text,
                       "a name of 1 to " + std::to_string(path_bytes_max) + " bytes must follow");
    return Endpoint{.transport =
                        scheme == "ipc" ? Endpoint::Transport::ipc : Endpoint::Transport::inproc,
                    .host = {},
                    .port = 0,
                    .path = std::string(rest)};
}

std::string to_string(const Endpoint& e) {
    switch (e.transport) {
    case Endpoint::Transport::tcp:
        return "tcp://" + e.host + ":" + std::to_string(e.port);
    case Endpoint::Transport::ipc:
        return "ipc://" + e.path;
    case Endpoint::Transport::inproc:
        return "inproc://" + e.path;
    }
    return {};
}

std::string without_brackets(const std::string& host) {
    return host.starts_with('[') && host.ends_with(']') ? host.substr(1, host.size() - 2) : host;
}

bool is_loopback(const Endpoint& e) {
    return e.transport != Endpoint::Transport::tcp || e.host == "localhost" || e.host == "[::1]" ||
           e.host.starts_with("127.");
}

Result<std::string> endpoint_to_bind(std::string_view text, std::uint16_t default_port,
                                     bool open_to_all) {
    auto endpoint = parse_endpoint(text, default_port);
    if (!endpoint)
        return endpoint.error();
    if (endpoint->host == "localhost") // ZeroMQ would look for a network interface of that name
        endpoint->host = "127.0.0.1";
    if (!open_to_all && !is_loopback(*endpoint))
        return Error{ErrorCode::invalid_argument,
                     to_string(*endpoint) +
                         " can be reached from other machines, and without keys friend cannot be "
                         "told from stranger: give it --key-file and --allow, use a loopback "
                         "address, or say --insecure on a network you trust"};
    return to_string(*endpoint);
}

Result<std::string> endpoint_to_connect(std::string_view text, std::uint16_t default_port) {
    const auto endpoint = parse_endpoint(text, default_port);
    if (!endpoint)
        return endpoint.error();
    if (endpoint->transport == Endpoint::Transport::inproc)
        return invalid(text, "inproc does not leave this process");
    if (endpoint->host == "*")
        return invalid(text, "host * is a place to listen at, not one to connect to");
    if (endpoint->transport == Endpoint::Transport::tcp && endpoint->port == 0)
        return invalid(text, "a port is missing, from 1 to 65535");
    return to_string(*endpoint);
}

Result<std::string> stream_endpoint(std::string_view reached, std::string_view told) {
    auto ours = parse_endpoint(reached, 0);
    if (!ours)
        return ours.error();
    const auto theirs = parse_endpoint(told, 0);
    if (!theirs)
        return theirs.error();
    if (ours->transport != Endpoint::Transport::tcp ||
        theirs->transport != Endpoint::Transport::tcp)
        return std::string(told);
    ours->port = theirs->port;
    return to_string(*ours);
}

} // namespace fraja::net
