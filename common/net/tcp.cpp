#include "common/net/tcp.hpp"

#include "common/net/clock.hpp"
#include "common/net/endpoint.hpp"

#include <array>
#include <cerrno>
#include <cstring>
#include <memory>
#include <netdb.h>
#include <poll.h>
#include <system_error>
#include <unistd.h>
#include <utility>

namespace fraja::net {
namespace {

/// Until the socket can be written to, or not: 0, or why not.
int await_connection(int fd, Duration timeout, const Interrupt& interrupt) {
    const Instant end = now() + timeout;
    while (!interrupt.stop.stop_requested()) {
        const Duration left = end - now();
        if (left <= Duration::zero())
            return ETIMEDOUT;
        std::array<pollfd, 2> entries = {
            {{fd, POLLOUT, 0}, {interrupt.waker ? interrupt.waker->fd() : -1, POLLIN, 0}}};
        const auto ms = std::chrono::ceil<std::chrono::milliseconds>(left);
        if (::poll(entries.data(), entries.size(), static_cast<int>(ms.count())) <= 0)
            continue;
        if (entries[1].revents != 0)
            interrupt.waker->drain();
        if (entries[0].revents == 0)
            continue;
        int error = 0;
        socklen_t size = sizeof error;
        return ::getsockopt(fd, SOL_SOCKET, SO_ERROR, &error, &size) == 0 ? error : errno;
    }
    return ECANCELED;
}

/// 0: it stands.
int error_of_connecting(int fd, const TcpAddress& address, Duration timeout,
                        const Interrupt& interrupt) {
    if (fd < 0)
        return errno;
    if (::connect(fd, reinterpret_cast<const sockaddr*>(&address.bytes), address.size) == 0)
        return 0;
    return errno == EINPROGRESS ? await_connection(fd, timeout, interrupt) : errno;
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

Result<std::vector<TcpAddress>> addresses_of(const std::string& host, std::uint16_t port) {
    const std::string name = without_brackets(host);
    addrinfo wanted{};
    wanted.ai_socktype = SOCK_STREAM;
    addrinfo* found = nullptr;
    const int failed = getaddrinfo(name.c_str(), std::to_string(port).c_str(), &wanted, &found);
    if (failed == EAI_NONAME)
        return Error{ErrorCode::not_found, "there is no host '" + name + "'"};
    if (failed != 0)
        return Error{ErrorCode::not_found,
                     "host '" + name + "' cannot be looked up: " + gai_strerror(failed)};
    const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> owner(found, &freeaddrinfo);
    std::vector<TcpAddress> addresses;
    for (const addrinfo* each = found; each; each = each->ai_next) {
        TcpAddress& address = addresses.emplace_back();
        address.size = each->ai_addrlen;
        std::memcpy(&address.bytes, each->ai_addr, each->ai_addrlen);
    }
    return addresses;
}

TcpSocket::~TcpSocket() {
    if (fd_ >= 0)
        ::close(fd_);
}

TcpSocket::TcpSocket(TcpSocket&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}

TcpSocket& TcpSocket::operator=(TcpSocket&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
}

Result<TcpConnection> connect_to(std::span<const TcpAddress> addresses, Duration timeout,
                                 const Interrupt& interrupt) {
    int error = EADDRNOTAVAIL;
    for (const TcpAddress& address : addresses) {
        const Instant begin = now();
        TcpSocket socket(
            ::socket(address.bytes.ss_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
        error = error_of_connecting(socket.fd(), address, timeout, interrupt);
        if (error == 0)
            return TcpConnection{std::move(socket), now() - begin};
        if (error == ECANCELED)
            return Error{ErrorCode::cancelled, in_words(error)};
    }
    return Error{ErrorCode::unreachable, in_words(error)};
}

} // namespace fraja::net
