// Plain TCP connections, for what does not speak through ZeroMQ: a name's addresses, and a
// connection to the first of them that takes one.
#pragma once

#include "common/base/instant.hpp"
#include "common/base/result.hpp"
#include "common/net/waker.hpp"

#include <cstdint>
#include <span>
#include <stop_token>
#include <string>
#include <sys/socket.h>
#include <vector>

namespace fraja::net {

struct TcpAddress {
    sockaddr_storage bytes{};
    socklen_t size = 0;
};

/// All that the system knows of a host, in the order in which they are to be tried; at least one.
/// `host` as in Endpoint; looking up a name may take some seconds. Errors: not_found.
[[nodiscard]] Result<std::vector<TcpAddress>> addresses_of(const std::string& host,
                                                           std::uint16_t port);

/// A socket that is closed with this.
class TcpSocket {
public:
    TcpSocket() = default;
    explicit TcpSocket(int fd) : fd_(fd) {}
    ~TcpSocket();
    TcpSocket(TcpSocket&& other) noexcept;
    TcpSocket& operator=(TcpSocket&& other) noexcept;

    /// -1: there is none.
    [[nodiscard]] int fd() const { return fd_; }

private:
    int fd_ = -1;
};

struct TcpConnection {
    TcpSocket socket; ///< does not block
    Duration took{};  ///< to the address that took it
};

/// How whoever waits for a connection is told not to.
struct Interrupt {
    std::stop_token stop;
    const Waker* waker = nullptr; ///< woken when `stop` is requested; other wakes are forgotten
};

/// To the first of the addresses that takes one; waits for each as long as `timeout`. Errors:
/// unreachable, with what hinders it at the last address in words ("nothing listens there");
/// cancelled.
[[nodiscard]] Result<TcpConnection> connect_to(std::span<const TcpAddress> addresses,
                                               Duration timeout, const Interrupt& interrupt = {});

} // namespace fraja::net
