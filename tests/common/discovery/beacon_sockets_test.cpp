#include "common/discovery/announcer.hpp"
#include "common/discovery/beacon_sockets.hpp"
#include "common/discovery/finder.hpp"
#include "tests/support/network_or_skip.hpp"

#include <arpa/inet.h>
#include <doctest/doctest.h>
#include <memory>
#include <netinet/in.h>
#include <optional>
#include <poll.h>
#include <string>
#include <sys/socket.h>
#include <unistd.h>
#include <vector>

using namespace fraja;
using namespace fraja::discovery;

namespace {

constexpr int hearing_ms = 20'000; // passes at once, unless something is wrong

std::unique_ptr<BeaconReceiver> receiver_on(const TestNetwork& network, std::size_t host) {
    std::unique_ptr<BeaconReceiver> receiver;
    network.visit(host, [&] {
        auto opened = BeaconReceiver::open();
        REQUIRE(opened);
        receiver = std::make_unique<BeaconReceiver>(*std::move(opened));
    });
    return receiver;
}

std::size_t send_on(const TestNetwork& network, std::size_t host, const BeaconWays& ways,
                    const Bytes& bytes) {
    std::size_t count = 0;
    network.visit(host, [&] {
        const auto sender = BeaconSender::open(ways);
        REQUIRE(sender);
        count = sender->send(bytes);
    });
    return count;
}

Datagram next_of(const BeaconReceiver& receiver) {
    for (;;) {
        if (auto datagram = receiver.receive())
            return *datagram;
        pollfd readable[] = {{receiver.fd(), POLLIN, 0}, {receiver.fd6(), POLLIN, 0}};
        REQUIRE(::poll(readable, 2, hearing_ms) > 0);
    }
}

void send_to(const TestNetwork& network, std::size_t host, const std::string& address,
             const Bytes& bytes) {
    network.visit(host, [&] {
        const int fd = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
        sockaddr_in to{};
        to.sin_family = AF_INET;
        to.sin_port = htons(beacon_port);
        REQUIRE(::inet_pton(AF_INET, address.c_str(), &to.sin_addr) == 1);
        CHECK(::sendto(fd, bytes.data(), bytes.size(), 0, reinterpret_cast<const sockaddr*>(&to),
                       sizeof to) == static_cast<ssize_t>(bytes.size()));
        ::close(fd);
    });
}

} // namespace

TEST_CASE("a beacon reaches all of a link by each of its ways, and no other link") {
    auto network = network_or_skip(3);
    if (!network)
        return;
    const auto near = receiver_on(*network, 1), far = receiver_on(*network, 2);
    network->divide({{0, 1}, {2}});
    struct Row {
        BeaconWays ways;
        std::string sender;
    };
    for (const Row& row : {
             Row{{.broadcast = true, .multicast = false, .ipv4 = true, .ipv6 = true}, "10.77.0.1"},
             Row{{.broadcast = false, .multicast = true, .ipv4 = true, .ipv6 = false}, "10.77.0.1"},
             Row{{.broadcast = false, .multicast = true, .ipv4 = false, .ipv6 = true},
                 "[fe80::1%eth0]"},
         }) {
        CAPTURE(row.sender);
        CHECK(send_on(*network, 0, row.ways, to_bytes("hello")) == 1);
        Datagram heard;
        network->visit(1, [&] { heard = next_of(*near); }); // where its interface has that name
        CHECK(heard.bytes == to_bytes("hello"));
        CHECK(heard.sender == row.sender);
    }
    network->join();
    CHECK(send_on(*network, 0, {}, to_bytes("to all")) == 3);
    CHECK(next_of(*far).bytes == to_bytes("to all")); // and nothing before
}

TEST_CASE("what was sent to one machine alone is no beacon, nor is what is too long") {
    const auto network = network_or_skip(2);
    if (!network)
        return;
    const auto receiver = receiver_on(*network, 1);
    send_to(*network, 0, TestNetwork::address(1), to_bytes("from afar"));
    CHECK(next_of(*receiver).bytes.empty());
    CHECK(send_on(*network, 0, {.multicast = false}, Bytes(1000)) == 1);
    CHECK(next_of(*receiver).bytes.size() == beacon_bytes + 1);
}

TEST_CASE("several programs of one machine hear the same beacon") {
    const auto network = network_or_skip(2);
    if (!network)
        return;
    const auto first = receiver_on(*network, 1), second = receiver_on(*network, 1),
               beside = receiver_on(*network, 0);
    CHECK(send_on(*network, 0, {.multicast = false}, to_bytes("broadcast")) == 1);
    CHECK(send_on(*network, 0, {.broadcast = false, .ipv6 = false}, to_bytes("multicast")) == 1);
    for (const auto* receiver : {&first, &second, &beside})
        for (const char* text : {"broadcast", "multicast"})
            CHECK(next_of(**receiver).bytes == to_bytes(text));
}

TEST_CASE("a machine without a network sends nothing, and hears others when there is one") {
    const auto network = network_or_skip(2);
    if (!network)
        return;
    const auto run_on = [&](std::size_t host, const char* script) {
        const auto done =
            run(network->on(host, {{"/bin/sh", "-ec", script}}), std::chrono::seconds(20));
        REQUIRE(done);
        REQUIRE(done->exit == 0);
    };
    run_on(1, "ip link set eth0 down");
    CHECK(send_on(*network, 1, {}, to_bytes("hello")) == 0);
    const auto receiver = receiver_on(*network, 1);
    run_on(1, "ip link set eth0 up");
    network->visit(1, [&] { receiver->join_groups(); });
    std::optional<Datagram> heard; // the switch takes its time to notice
    for (int tries = 0; !heard && tries < 200; ++tries) {
        CHECK(send_on(*network, 0, {.broadcast = false, .ipv6 = false}, to_bytes("hello")) == 1);
        pollfd readable{receiver->fd(), POLLIN, 0};
        (void)::poll(&readable, 1, 100);
        heard = receiver->receive();
    }
    REQUIRE(heard);
    CHECK(heard->bytes == to_bytes("hello"));
}

TEST_CASE("a finder hears an announcer, until it is gone") {
    const auto network = network_or_skip(2);
    if (!network)
        return;
    std::unique_ptr<Finder> finder;
    network->visit(1, [&] {
        finder = std::make_unique<Finder>(std::vector<std::string>{"auto"}, FinderOptions{});
    });
    Findings last;
    const auto wait_for = [&](const std::vector<std::string>& wanted) {
        while (last.endpoints != wanted) {
            pollfd readable{finder->fd(), POLLIN, 0};
            REQUIRE(::poll(&readable, 1, hearing_ms) == 1);
            for (const Findings& findings : finder->take())
                last = findings;
        }
    };
    std::unique_ptr<Announcer> announcer;
    network->visit(0, [&] {
        auto sender = BeaconSender::open({.ipv6 = false});
        REQUIRE(sender);
        announcer = std::make_unique<Announcer>(*std::move(sender), Beacon{.port = 7},
                                                [](const LogLine&) {});
    });
    wait_for({"tcp://10.77.0.1:7"});
    announcer.reset();
    wait_for({});
}

TEST_CASE("announcement_of says where others reach a broker") {
    struct Row {
        std::string bound, advertised, host;
        bool ipv6;
    };
    for (const Row& row : {
             Row{"tcp://0.0.0.0:7", "", "", false},
             Row{"tcp://*:7", "", "", true},
             Row{"tcp://[::]:7", "", "", true},
             Row{"tcp://10.0.0.1:7", "", "10.0.0.1", true},
             Row{"tcp://[fd77::1]:7", "", "[fd77::1]", true},
             Row{"tcp://127.0.0.1:8", "tcp://farm:7", "farm", true},
         }) {
        CAPTURE(row.bound);
        const auto announcement = announcement_of(row.bound, row.advertised, nullptr, {});
        REQUIRE(announcement);
        CHECK(announcement->beacon == Beacon{.port = 7, .host = row.host});
        CHECK(announcement->ways.ipv6 == row.ipv6);
    }
    const net::PublicKey key{std::string(40, 'a')};
    CHECK(announcement_of("tcp://*:7", "", &key, {})->beacon.farm == fingerprint_of(key));
    for (const char* nowhere : {"tcp://127.0.0.1:7", "tcp://[::1]:7", "ipc:///tmp/x"}) {
        const auto announcement = announcement_of(nowhere, "", nullptr, {});
        REQUIRE_FALSE(announcement);
        CHECK(announcement.error().message.find("no other machine reaches") != std::string::npos);
    }
    CHECK_FALSE(announcement_of("tcp://*:7", "tcp://" + std::string(65, 'h') + ":7", nullptr, {}));
}
