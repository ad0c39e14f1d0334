#include "common/net/reach.hpp"

#include "common/net/endpoint.hpp"

#include <optional>

namespace fraja::net {

namespace {

/// Nothing: of another transport.
std::optional<Result<Duration>> reach_endpoint(const std::string& endpoint,
                                               const Interrupt& interrupt) {
    const auto parsed = parse_endpoint(endpoint, 0);
    if (!parsed || parsed->transport != Endpoint::Transport::tcp)
        return std::nullopt;
    return reach(parsed->host, parsed->port, interrupt);
}

} // namespace

Result<Duration> reach(const std::string& host, std::uint16_t port, const Interrupt& interrupt) {
    const auto addresses = addresses_of(host, port);
    if (!addresses)
        return addresses.error();
    const auto connection = connect_to(*addresses, reach_timeout, interrupt);
    if (!connection)
        return connection.error();
    return connection->took;
}

std::string why_unreached(const std::string& endpoint, const Interrupt& interrupt) {
    const auto reached = reach_endpoint(endpoint, interrupt);
    return !reached || *reached ? std::string() : reached->error().message;
}

std::string why_silent(const std::string& endpoint) {
    const auto reached = reach_endpoint(endpoint, {});
    if (!reached)
        return {};
    return *reached ? "something listens there, but does not answer as a broker does"
                    : reached->error().message;
}

} // namespace fraja::net
