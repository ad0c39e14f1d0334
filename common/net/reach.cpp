#include "common/net/reach.hpp"

#include "common/net/clock.hpp"

#include <algorithm>
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

std::string reason_of(int error) {
    return std::error_code(error, std::generic_category()).message();
}

/// Brackets are an endpoint's, not the address's.
std::string bare(const std::string& host) {
    return host.size() > 2 && host.front() == '[' ? host.substr(1, host.size() - 2) : host;
}

Result<Addresses> addresses_of(const std::string& host, std::uint16_t port) {
    addrinfo wanted{};
    wanted.ai_socktype = SOCK_STREAM;
    addrinfo* found = nullptr;
    const int failed =
        getaddrinfo(bare(host).c_str(), std::to_string(port).c_str(), &wanted, &found);
    if (failed != 0)
        return Error{ErrorCode::not_found,
                     "the name " + host + " is not known: " +
                         (failed == EAI_SYSTEM ? reason_of(errno) : gai_strerror(failed))};
    return Addresses(found, &freeaddrinfo);
}

/// Why not; 0: it can.
int try_address(const addrinfo& address, Duration patience) {
    const Descriptor socket_(::socket(address.ai_family,
                                      address.ai_socktype | SOCK_NONBLOCK | SOCK_CLOEXEC,
                                      address.ai_protocol));
    if (socket_.get() < 0)
        return errno;
    if (connect(socket_.get(), address.ai_addr, address.ai_addrlen) == 0)
        return 0;
    if (errno != EINPROGRESS)
        return errno;
    pollfd writable{socket_.get(), POLLOUT, 0};
    const auto wait = std::chrono::ceil<std::chrono::milliseconds>(patience);
    if (poll(&writable, 1, static_cast<int>(wait.count())) <= 0)
        return ETIMEDOUT;
    int error = 0;
    socklen_t size = sizeof error;
    return getsockopt(socket_.get(), SOL_SOCKET, SO_ERROR, &error, &size) == 0 ? error : errno;
}

} // namespace

Result<Duration> reach(const std::string& host, std::uint16_t port, Duration patience) {
    const auto addresses = addresses_of(host, port);
    if (!addresses)
        return addresses.error();
    int error = EADDRNOTAVAIL;
    for (const addrinfo* address = addresses->get(); address; address = address->ai_next) {
        const Instant begin = now();
        error = try_address(*address, std::min<Duration>(patience, std::chrono::hours(1)));
        if (error == 0)
            return now() - begin;
    }
    return Error{ErrorCode::unreachable, reason_of(error)};
}

} // namespace fraja::net
