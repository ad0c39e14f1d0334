#include "common/net/reach.hpp"

#include "common/net/endpoint.hpp"
#include "common/net/tcp.hpp"

namespace fraja::net {

Result<Duration> reach(const std::string& host, std::uint16_t port) {
    const auto addresses = addresses_of(host, port);
    if (!addresses)
        return addresses.error();
    const auto connection = connect_to(*addresses, reach_timeout);
    if (!connection)
        return connection.error();
    return connection->took;
}

std::string why_silent(const std::string& endpoint) {
    const auto parsed = parse_endpoint(endpoint, 0);
    if (!parsed || parsed->transport != Endpoint::Transport::tcp)
        return {};
    const auto reached = reach(parsed->host, parsed->port);
    return reached ? "something listens there, but does not answer as a broker does"
                   : reached.error().message;
}

} // namespace fraja::net
