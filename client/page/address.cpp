#include "client/page/address.hpp"

#include "common/http/address.hpp"

namespace fraja::client {
namespace {

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
    const http::Address at = http::address_of(*endpoint);
    return PageAddress{at.host, at.port, reaches_itself_alone(*endpoint)};
}

bool is_loopback_host(std::string_view host) {
    const auto endpoint = net::parse_endpoint("tcp://" + std::string(host), page_port);
    return endpoint && reaches_itself_alone(*endpoint);
}

std::string page_url(const PageAddress& address, std::string_view machine, std::string_view token) {
    const bool everywhere = address.host == http::every_interface || address.host == "::";
    const std::string host = everywhere ? std::string(machine) : address.host;
    std::string url = to_string(http::Address{host, address.port}) + "/";
    if (!token.empty())
        url += "?token=" + std::string(token);
    return url;
}

} // namespace fraja::client
