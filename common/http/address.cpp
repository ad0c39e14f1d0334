#include "common/http/address.hpp"

#include "common/base/assert.hpp"

#include <cerrno>
#include <fcntl.h>
#include <httplib.h>
#include <sys/socket.h>
#include <system_error>

namespace fraja::http {
namespace {

constexpr int backlog = 1024; // cpp-httplib's own 5 makes a herd wait for seconds

/// cpp-httplib's own choice is SO_REUSEPORT: of two servers at one address each would get some of
/// the requests.
void own_address(socket_t socket) {
    const int yes = 1;
    setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
}

/// Of a server of the library's only its socket.
class Binding : httplib::Server {
public:
    /// The port, or a negative number, and errno where the system said why.
    int bind(const Address& address) {
        set_socket_options(own_address);
        errno = 0;
        if (address.port == 0)
            return bind_to_any_port(address.host);
        return bind_to_port(address.host, address.port) ? address.port : -1;
    }
    [[nodiscard]] int release() { return svr_sock_.exchange(INVALID_SOCKET); }
};

} // namespace

Address address_of(const net::Endpoint& endpoint) {
    FRAJA_ASSERT(endpoint.transport == net::Endpoint::Transport::tcp);
    return {endpoint.host == "*" ? every_interface : net::without_brackets(endpoint.host),
            endpoint.port};
}

std::string to_string(const Address& address) {
    const bool is_v6 = address.host.find(':') != std::string::npos;
    return "http://" + (is_v6 ? "[" + address.host + "]" : address.host) + ":" +
           std::to_string(address.port);
}

Result<Listener> listen_at(const Address& address) {
    Binding binding;
    const int port = binding.bind(address);
    if (port <= 0)
        return Error{errno == EADDRINUSE ? ErrorCode::in_use : ErrorCode::io,
                     to_string(address) + ": cannot listen there: " +
                         (errno != 0 ? std::generic_category().message(errno)
                                     : "no such address on this machine") +
                         " (with port 0 the system chooses one)"};
    Listener listener{binding.release(), {address.host, static_cast<std::uint16_t>(port)}};
    FRAJA_ASSERT(listen(listener.fd, backlog) == 0);
    // Whoever came may be gone when it is let in: nobody waits for the next one then.
    FRAJA_ASSERT(fcntl(listener.fd, F_SETFL, O_NONBLOCK) == 0);
    return listener;
}

} // namespace fraja::http
