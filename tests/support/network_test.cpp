#include "tests/support/network.hpp"

#include "tests/support/network_or_skip.hpp"

#include <arpa/inet.h>
#include <array>
#include <cstring>
#include <doctest/doctest.h>
#include <netinet/in.h>
#include <optional>
#include <poll.h>
#include <string>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>
#include <vector>

using namespace fraja;
using namespace std::chrono_literals;

namespace {

constexpr Duration patience = 20s; // passes at once, unless something is wrong
constexpr std::uint16_t port = 7007;

/// A host's, at one port of either family.
class Datagrams {
public:
    Datagrams(const TestNetwork& network, std::size_t host) {
        network.visit(host, [this] { open(); });
    }
    ~Datagrams() {
        ::close(fd_);
        ::close(fd6_);
    }
    Datagrams(const Datagrams&) = delete;
    Datagrams& operator=(const Datagrams&) = delete;

    void send(const std::string& address, const std::string& text) const {
        sockaddr_in to{};
        to.sin_family = AF_INET;
        to.sin_port = htons(port);
        REQUIRE(::inet_pton(AF_INET, address.c_str(), &to.sin_addr) == 1);
        CHECK(::sendto(fd_, text.data(), text.size(), 0, reinterpret_cast<const sockaddr*>(&to),
                       sizeof to) == static_cast<ssize_t>(text.size()));
    }
    void send6(const std::string& address, const std::string& text) const {
        sockaddr_in6 to{};
        to.sin6_family = AF_INET6;
        to.sin6_port = htons(port);
        REQUIRE(::inet_pton(AF_INET6, address.c_str(), &to.sin6_addr) == 1);
        CHECK(::sendto(fd6_, text.data(), text.size(), 0, reinterpret_cast<const sockaddr*>(&to),
                       sizeof to) == static_cast<ssize_t>(text.size()));
    }
    [[nodiscard]] std::string receive() const { return receive_at(fd_); }
    [[nodiscard]] std::string receive6() const { return receive_at(fd6_); }

private:
    void open() {
        const int yes = 1;
        fd_ = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
        sockaddr_in here{};
        here.sin_family = AF_INET;
        here.sin_port = htons(port);
        REQUIRE(::bind(fd_, reinterpret_cast<const sockaddr*>(&here), sizeof here) == 0);
        REQUIRE(::setsockopt(fd_, SOL_SOCKET, SO_BROADCAST, &yes, sizeof yes) == 0);
        fd6_ = ::socket(AF_INET6, SOCK_DGRAM | SOCK_CLOEXEC, 0);
        sockaddr_in6 here6{};
        here6.sin6_family = AF_INET6;
        here6.sin6_port = htons(port);
        REQUIRE(::setsockopt(fd6_, IPPROTO_IPV6, IPV6_V6ONLY, &yes, sizeof yes) == 0);
        REQUIRE(::bind(fd6_, reinterpret_cast<const sockaddr*>(&here6), sizeof here6) == 0);
    }
    static std::string receive_at(int fd) {
        pollfd readable{fd, POLLIN, 0};
        if (::poll(&readable, 1,
                   static_cast<int>(
                       std::chrono::duration_cast<std::chrono::milliseconds>(patience).count())) !=
            1)
            return "nothing came";
        std::array<char, 256> buffer{};
        const ssize_t n = ::recv(fd, buffer.data(), buffer.size(), 0);
        return std::string(buffer.data(), static_cast<std::size_t>(std::max<ssize_t>(n, 0)));
    }

    int fd_ = -1, fd6_ = -1;
};

} // namespace

TEST_CASE("hosts of a test network reach one another, by broadcast too, and nobody else") {
    const auto network = network_or_skip(3);
    if (!network)
        return;
    const Datagrams first(*network, 0), second(*network, 1), third(*network, 2);
    first.send(TestNetwork::address(1), "to the second");
    CHECK(second.receive() == "to the second");
    second.send6(TestNetwork::address6(2), "to the third");
    CHECK(third.receive6() == "to the third");
    third.send("10.77.0.255", "to all");
    CHECK(first.receive() == "to all");
    CHECK(second.receive() == "to all");

    const auto on_host = run(network->on(1, {{"ip", "-oneline", "address"}}), patience);
    REQUIRE(on_host);
    INFO(on_host->out << on_host->err);
    CHECK(on_host->exit == 0);
    CHECK(on_host->out.find("10.77.0.2/24") != std::string::npos);
    const auto way_out = run(network->on(1, {{"ip", "route", "show", "default"}}), patience);
    REQUIRE(way_out);
    CHECK(way_out->out.empty());
    const auto outside = run({{"ip", "-oneline", "link"}}, patience);
    REQUIRE(outside);
    CHECK(outside->out.find("port0") == std::string::npos);
}

TEST_CASE("a program on a host is a process as any other") {
    const auto network = network_or_skip(1);
    if (!network)
        return;
    auto process = Process::start(network->on(0, {{"/bin/sh", "-c", "echo $$; exec sleep 600"}}));
    REQUIRE(process);
    const auto line = process->wait_for_line(
        Process::Stream::out, [](auto) { return true; }, patience);
    REQUIRE(line);
    CHECK(*line == std::to_string(process->pid()));
}

TEST_CASE("a test network that is divided passes frames within its groups alone") {
    auto network = network_or_skip(4);
    if (!network)
        return;
    const Datagrams a(*network, 0), b(*network, 1), c(*network, 2), d(*network, 3);
    const auto all_know_each_other = [&](const Datagrams& from, const Datagrams& to,
                                         std::size_t number) {
        from.send(TestNetwork::address(number), "hello"); // what waits for its address is not lost
        REQUIRE(to.receive() == "hello");
    };
    all_know_each_other(a, b, 1);
    all_know_each_other(a, c, 2);
    all_know_each_other(a, d, 3);
    network->divide({{0, 1}, {2}});
    a.send(TestNetwork::address(1), "within");
    a.send(TestNetwork::address(2), "lost");
    a.send(TestNetwork::address(3), "lost");
    a.send("10.77.0.255", "to the group");
    CHECK(b.receive() == "within");
    CHECK(b.receive() == "to the group");
    network->join();
    a.send("10.77.0.255", "to all");
    CHECK(b.receive() == "to all");
    CHECK(c.receive() == "to all");
    CHECK(d.receive() == "to all");
}

TEST_CASE("a way through a test network that is cut is cut in one direction") {
    auto network = network_or_skip(3);
    if (!network)
        return;
    const Datagrams a(*network, 0), b(*network, 1), c(*network, 2);
    network->cut(0, 1);
    a.send(TestNetwork::address(1), "lost");
    a.send6(TestNetwork::address6(1), "lost");
    a.send(TestNetwork::address(2), "beside it");
    CHECK(c.receive() == "beside it");
    b.send(TestNetwork::address(0), "the other way");
    CHECK(a.receive() == "the other way");
    network->mend(0, 1);
    a.send(TestNetwork::address(1), "mended");
    CHECK(b.receive() == "mended");
    a.send6(TestNetwork::address6(1), "mended, too");
    CHECK(b.receive6() == "mended, too");
}
