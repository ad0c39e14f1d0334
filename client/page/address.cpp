#include "client/page/address.hpp"

#include "common/net/endpoint.hpp"

namespace fraja::client {
namespace {

constexpr std::string_view every_interface = "0.0.0.0";

bool reaches_itself_alone(const net::Endpoint& e) {
    const bool named = e.host.find_first_not_of("0123456789.") != std::string::npos;
    return net::is_loopback(e) && !(named && e.host.starts_with("127."));
}

} // namespace

Result<PageAddress> parse_page_address(std::string_view text) {
    if (text.empty())
        return PageAddress{};
    const auto invalid = [&](const std::string& why) {
        return Error{ErrorCode::invalid_argument,
                     "--serve " + std::string(text) + ": " + why +
                         " (ADDR:PORT, as 127.0.0.1:50060; a JOB goes before --serve)"};
    };
    if (text.find(':') == std::string_view::npos)
        return invalid("a port is missing");
    const auto endpoint = net::parse_endpoint(text, page_port);
    if (!endpoint)
        return invalid(endpoint.error().message);
    if (endpoint->transport != net::Endpoint::Transport::tcp)
        return invalid("a browser speaks tcp alone");
    PageAddress address{endpoint->host, endpoint->port, reaches_itself_alone(*endpoint)};
    if (address.host == "*")
        address.host = every_interface;
    if (address.host.starts_with('[') && address.host.ends_with(']'))
        address.host = address.host.substr(1, address.host.size() - 2);
    return address;
}

bool is_loopback_host(std::string_view host) {
    const auto endpoint = net::parse_endpoint("tcp://" + std::string(host), page_port);
    return endpoint && reaches_itself_alone(*endpoint);
}

std::string page_url(const PageAddress& address, std::string_view machine, std::string_view token) {
    std::string host = address.host;
    if (host == every_interface || host == "::")
        host = machine;
    else if (host.find(':') != std::string::npos)
        host = "[" + host + "]";
    std::string url = "http://" + host + ":" + std::to_string(address.port) + "/";
    if (!token.empty())
        url += "?token=" + std::string(token);
    return url;
}

} // namespace fraja::client
