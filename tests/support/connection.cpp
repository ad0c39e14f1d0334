#include "tests/support/connection.hpp"

#include "common/base/assert.hpp"
#include "common/base/text.hpp"

#include <arpa/inet.h>
#include <array>
#include <chrono>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>

namespace fraja {

Connection::Connection(std::uint16_t port) : fd_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    FRAJA_ASSERT(fd_ >= 0);
    FRAJA_ASSERT(connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0);
}

Connection::~Connection() {
    if (fd_ >= 0)
        close(fd_);
}

Connection::Connection(Connection&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}

bool Connection::say(std::string_view bytes) {
    return send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL) ==
           static_cast<ssize_t>(bytes.size());
}

void Connection::close_writing() {
    shutdown(fd_, SHUT_WR);
}

Connection::Came Connection::read(std::string& to, Duration timeout) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(timeout);
    pollfd readable{fd_, POLLIN, 0};
    if (left.count() <= 0 || poll(&readable, 1, static_cast<int>(left.count())) <= 0)
        return Came::nothing;
    std::array<char, 65536> bytes;
    const auto size = recv(fd_, bytes.data(), bytes.size(), 0);
    if (size <= 0) // closed, or reset
        return Came::end;
    to.append(bytes.data(), static_cast<std::size_t>(size));
    return Came::bytes;
}

std::optional<std::string> Connection::read_to_end(Duration timeout) {
    const auto end = std::chrono::steady_clock::now() + timeout;
    std::string all;
    for (;;)
        switch (read(all, end - std::chrono::steady_clock::now())) {
        case Came::bytes:
            break;
        case Came::end:
            return all;
        case Came::nothing:
            return std::nullopt;
        }
}

std::optional<std::string> Connection::read_until(std::string_view last, Duration timeout) {
    const auto end = std::chrono::steady_clock::now() + timeout;
    std::string all;
    while (!all.ends_with(last))
        if (read(all, end - std::chrono::steady_clock::now()) != Came::bytes)
            return std::nullopt;
    return all;
}

std::uint16_t port_of(std::string_view address) {
    const auto port = parse_count(address.substr(address.rfind(':') + 1));
    FRAJA_ASSERT(port.has_value());
    return static_cast<std::uint16_t>(*port);
}

HttpAnswer ask_http(std::uint16_t port, std::string_view method, std::string_view path,
                    Duration timeout) {
    Connection connection(port);
    connection.say(std::string(method) + " " + std::string(path) +
                   " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
    const std::string all = connection.read_to_end(timeout).value_or("");
    const std::size_t blank = all.find("\r\n\r\n");
    if (!all.starts_with("HTTP/1.1 ") || blank == std::string::npos)
        return {};
    return {static_cast<int>(parse_count(all.substr(9, 3)).value_or(0)), all.substr(0, blank),
            all.substr(blank + 4)};
}

} // namespace fraja
