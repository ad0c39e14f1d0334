#include "common/net/poller.hpp"

#include "common/net/clock.hpp"
#include "common/net/waker.hpp"

#include <chrono>
#include <doctest/doctest.h>
#include <optional>
#include <set>
#include <string>
#include <vector>

using namespace fraja;
using namespace fraja::net;
using namespace std::chrono_literals;

namespace {

constexpr std::size_t dealer_count = 20;

protocol::Packet packet(std::size_t number) {
    return {to_bytes("head"), to_bytes(std::to_string(number)), {}};
}

/// A router, and dealers that it knows by their numbers.
struct Net {
    Context context;
    RouterSocket router = std::move(*RouterSocket::bind(context, "tcp://127.0.0.1:*"));
    std::vector<DealerSocket> dealers;
    std::vector<PeerId> peers{dealer_count};
    Poller poller;

    Net() {
        dealers.reserve(dealer_count);
        for (std::size_t i = 0; i < dealer_count; ++i) {
            dealers.push_back(std::move(*DealerSocket::connect(context, router.endpoint())));
            poller.add(i, dealers[i]);
            while (dealers[i].send(packet(i)) != SendStatus::sent)
                net::wait({dealers[i]}, 1ms);
            poller.look_again(i);
        }
        for (std::size_t i = 0; i < dealer_count; ++i) {
            const RoutedMessage message = next();
            peers[std::stoul(std::string(as_text(message.frames.at(1))))] = message.peer;
        }
    }
    RoutedMessage next() {
        for (int i = 0; i < 600; ++i) {
            if (auto message = router.receive())
                return std::move(*message);
            net::wait({router}, 100ms);
        }
        FAIL("no message within a minute");
        return {};
    }
    /// The sockets that have something within a minute.
    const std::vector<std::size_t>& readable() {
        for (int i = 0; i < 600; ++i)
            if (const auto& ready = poller.wait(100ms); !ready.empty())
                return ready;
        FAIL("nothing within a minute");
        return poller.wait(0s);
    }
};

} // namespace

TEST_CASE("the poller names the sockets that have something, and no other") {
    Net net;
    CHECK(net.poller.wait(0s).empty());
    for (const std::size_t i : {3u, 17u})
        REQUIRE(net.router.send(net.peers[i], packet(i)) == SendStatus::sent);
    std::set<std::size_t> seen;
    while (seen.size() < 2)
        for (const std::size_t i : net.readable()) {
            seen.insert(i);
            while (net.dealers[i].receive()) {
            }
        }
    CHECK(seen == std::set<std::size_t>{3, 17});
    CHECK(net.poller.wait(10ms).empty());
}

TEST_CASE("a socket whose messages are not all received is named again") {
    Net net;
    for (const std::size_t n : {1u, 2u, 3u})
        REQUIRE(net.router.send(net.peers[5], packet(n)) == SendStatus::sent);
    for (int i = 0; i < 3; ++i) {
        REQUIRE(net.readable() == std::vector<std::size_t>{5});
        CHECK(net.dealers[5].receive().has_value());
    }
    CHECK(net.poller.wait(10ms).empty());
}

TEST_CASE("what comes while a socket sends is not lost") {
    Net net; // each answer provokes the next message: a thousand times to and fro, in step
    for (int round = 0; round < 1000; ++round) {
        const std::size_t i = static_cast<std::size_t>(round) % dealer_count;
        REQUIRE(net.router.send(net.peers[i], packet(i)) == SendStatus::sent);
        for (int sent = 0; sent < 3; ++sent) {
            REQUIRE(net.dealers[i].send(packet(i)) == SendStatus::sent);
            net.poller.look_again(i);
        }
        REQUIRE(net.readable() == std::vector<std::size_t>{i});
        CHECK(net.dealers[i].receive().has_value());
        for (int sent = 0; sent < 3; ++sent)
            (void)net.next();
    }
}

TEST_CASE("a wait ends for a file descriptor, and in time; a removed socket is not looked at") {
    Net net;
    const Waker waker;
    net.poller.add(waker.fd());
    waker.wake();
    CHECK(net.poller.wait(1min).empty());
    waker.drain();
    const Instant begin = now();
    CHECK(net.poller.wait(3ms).empty());
    CHECK(now() - begin >= 3ms);

    REQUIRE(net.router.send(net.peers[0], packet(0)) == SendStatus::sent);
    CHECK(net.readable() == std::vector<std::size_t>{0});
    net.poller.remove(0);
    CHECK(net.poller.wait(10ms).empty());
    net.poller.add(0, net.dealers[0]); // what waits there is seen
    CHECK(net.readable() == std::vector<std::size_t>{0});
}
