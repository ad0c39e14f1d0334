#include "common/net/reach.hpp"

#include "common/net/clock.hpp"
#include "common/net/endpoint.hpp"

#include <cerrno>
#include <memory>
#include <netdb.h>
#include <poll.h>
#include <sys/socket.h>
#include <system_error>
#include <unistd.h>

namespace fraja::net {
namespace {

class Descriptor {
public:
    explicit Descriptor(int fd) : fd_(fd) {}
    ~Descriptor() {
        if (fd_ >= 0)
            close(fd_);
    }
    Descriptor(const Descriptor&) = delete;
    Descriptor& operator=(const Descriptor&) = delete;
    [[nodiscard]] int get() const { return fd_; }

private:
    int fd_;
};

using Addresses = std::unique_ptr<addrinfo, decltype(&freeaddrinfo)>;

/// Brackets are an endpoint's, not the address's.
std::string bare(const std::string& host) {
    return host.starts_with('[') && host.ends_with(']') ? host.substr(1, host.size() - 2) : host;
}

Result<Addresses> addresses_of(const std::string& host, std::uint16_t port) {
    addrinfo wanted{};
    wanted.ai_socktype = SOCK_STREAM;
    addrinfo* found = nullptr;
    const int failed = getaddrinfo(host.c_str(), std::to_string(port).c_str(), &wanted, &found);
    if (failed == EAI_NONAME)
        return Error{ErrorCode::not_found, "there is no host '" + host + "'"};
    if (failed != 0)
        return Error{ErrorCode::not_found,
                     "host '" + host + "' cannot be looked up: " + gai_strerror(failed)};
    return Addresses(found, &freeaddrinfo);
}

/// 0: it stands.
int error_of_connecting(const addrinfo& address) {
    const Descriptor socket(
        ::socket(address.ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    if (socket.get() < 0)
        return errno;
    if (connect(socket.get(), address.ai_addr, address.ai_addrlen) == 0)
        return 0;
    if (errno != EINPROGRESS)
        return errno;
    pollfd connected{socket.get(), POLLOUT, 0};
    const auto timeout = std::chrono::duration_cast<std::chrono::milliseconds>(reach_timeout);
    if (poll(&connected, 1, static_cast<int>(timeout.count())) <= 0)
        return ETIMEDOUT;
    int error = 0;
    socklen_t size = sizeof error;
    return getsockopt(socket.get(), SOL_SOCKET, SO_ERROR, &error, &size) == 0 ? error : errno;
}

std::string in_words(int error) {
    switch (error) {
    case ECONNREFUSED:
        return "nothing listens there";
    case ETIMEDOUT:
        return "that host is not there, or a firewall is in between";
    case EHOSTUNREACH:
    case ENETUNREACH:
        return "there is no way to that host";
    default:
        return std::error_code(error, std::generic_category()).message();
    }
}

} // namespace

Result<Duration> reach(const std::string& host, std::uint16_t port) {
    const auto addresses = addresses_of(bare(host), port);
    if (!addresses)
        return addresses.error();
    int error = 0;
    for (const addrinfo* address = addresses->get(); address; address = address->ai_next) {
        const Instant begin = now();
        error = error_of_connecting(*address);
        if (error == 0)
            return now() - begin;
    }
    return Error{ErrorCode::unreachable, in_words(error)};
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
