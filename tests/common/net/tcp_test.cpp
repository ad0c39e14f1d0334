#include "common/net/tcp.hpp"

#include "common/net/endpoint.hpp"
#include "common/net/sockets.hpp"

#include <arpa/inet.h>
#include <doctest/doctest.h>
#include <netinet/in.h>
#include <thread>

using namespace fraja;
using namespace fraja::net;
using namespace std::chrono_literals;

namespace {

constexpr std::uint16_t silent_port = 1; // nobody listens there

TcpAddress address(const std::string& host, std::uint16_t port) {
    const auto found = addresses_of(host, port);
    REQUIRE(found.has_value());
    REQUIRE(!found->empty());
    return found->front();
}

} // namespace

TEST_CASE("an address is what is written, with an endpoint's brackets or without") {
    CHECK(address("127.0.0.1", 1).bytes.ss_family == AF_INET);
    CHECK(address("::1", 1).bytes.ss_family == AF_INET6);
    CHECK(address("[::1]", 1).bytes.ss_family == AF_INET6);
    CHECK(addresses_of("no-such-host.invalid", 1).error().code == ErrorCode::not_found);
}

TEST_CASE("the first address that takes a connection has it, the last says why none does") {
    const Context context;
    const auto router = RouterSocket::bind(context, "tcp://127.0.0.1:0");
    REQUIRE(router.has_value());
    const TcpAddress listens = address("127.0.0.1", parse_endpoint(router->endpoint(), 0)->port);
    const TcpAddress refuses = address("127.0.0.1", silent_port),
                     other = address("::1", silent_port);

    // As where a name is ::1 first, and only 127.0.0.1 is served.
    const auto connected = connect_to(std::vector{other, refuses, listens, refuses}, 5s);
    REQUIRE(connected.has_value());
    CHECK(connected->socket.fd() >= 0);
    sockaddr_in peer{};
    socklen_t size = sizeof peer;
    REQUIRE(getpeername(connected->socket.fd(), reinterpret_cast<sockaddr*>(&peer), &size) == 0);
    CHECK(ntohs(peer.sin_port) == parse_endpoint(router->endpoint(), 0)->port);

    const auto refused = connect_to(std::vector{other, refuses}, 5s);
    CHECK(refused.error().code == ErrorCode::unreachable);
    CHECK(refused.error().message == "nothing listens there");
    CHECK(connect_to({}, 5s).error().code == ErrorCode::unreachable);
}

TEST_CASE("a connection that nobody answers has its time, and can be given up") {
    // Its backlog is full: the system answers nobody who comes after that.
    const TcpSocket listener(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    sockaddr_in any{};
    any.sin_family = AF_INET;
    any.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    auto* const generic = reinterpret_cast<sockaddr*>(&any);
    socklen_t size = sizeof any;
    REQUIRE(bind(listener.fd(), generic, size) == 0);
    REQUIRE(listen(listener.fd(), 0) == 0);
    REQUIRE(getsockname(listener.fd(), generic, &size) == 0);
    const std::vector full = {address("127.0.0.1", ntohs(any.sin_port))};
    std::vector<TcpConnection> queued;
    for (;;) {
        auto connection = connect_to(full, 100ms);
        if (!connection) {
            CHECK(connection.error().code == ErrorCode::unreachable);
            break;
        }
        queued.push_back(std::move(*connection));
    }

    const Waker waker;
    std::stop_source stop;
    const std::stop_callback leave(stop.get_token(), [&] { waker.wake(); });
    waker.wake(); // about something else
    std::jthread stopping([&] { stop.request_stop(); });
    CHECK(connect_to(full, 1min, {stop.get_token(), &waker}).error().code == ErrorCode::cancelled);
}
