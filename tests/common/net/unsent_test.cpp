#include "common/net/unsent.hpp"

#include "common/net/clock.hpp"
#include "common/net/sockets.hpp"

#include <doctest/doctest.h>
#include <vector>
#include <zmq.hpp>

using namespace fraja;
using namespace fraja::net;
using namespace std::chrono_literals;

namespace {

Blob bytes_of(std::size_t size) {
    return Blob(Bytes(size));
}

} // namespace

TEST_CASE("bytes wait for a peer up to a limit, and one message of any size") {
    Unsent unsent(1'000);
    std::vector<Blob> waiting;
    const auto lend = [&](const std::string& peer, std::size_t bytes) {
        auto lent = unsent.lend(peer, bytes_of(bytes));
        if (lent)
            waiting.push_back(std::move(*lent));
        return lent.has_value();
    };
    CHECK(lend("a", 600));
    CHECK(lend("a", 400));
    CHECK_FALSE(lend("a", 1));
    CHECK(lend("b", 2'000));
    CHECK_FALSE(lend("b", 1));
    waiting.erase(waiting.begin());
    CHECK(lend("a", 600));
    CHECK(waiting.back() == bytes_of(600));
    waiting.clear();
    CHECK(lend("b", 1));
}

TEST_CASE("peers for whom nothing waits are forgotten, the others are not") {
    Unsent unsent(100);
    const auto waits = unsent.lend("slow", bytes_of(100));
    for (int i = 0; i < 10'000; ++i)
        CHECK(unsent.lend(std::to_string(i), bytes_of(100)).has_value());
    CHECK_FALSE(unsent.lend("slow", bytes_of(100)).has_value());
}

TEST_CASE("a peer that takes nothing costs a router half a gibibyte at most") {
    const Context context;
    auto router = RouterSocket::bind(context, "tcp://127.0.0.1:0");
    REQUIRE(router.has_value());
    zmq::context_t others;
    zmq::socket_t deaf(others, zmq::socket_type::dealer);
    deaf.set(zmq::sockopt::linger, 0);
    deaf.set(zmq::sockopt::rcvhwm, 1);
    deaf.connect(router->endpoint());
    (void)deaf.send(zmq::buffer(std::string_view("here I am")), zmq::send_flags::none);
    std::optional<RoutedMessage> first;
    for (int i = 0; i < 500 && !(first = router->receive()); ++i)
        wait({*router}, 10ms);
    REQUIRE(first.has_value());
    const protocol::Packet chunk{
        to_bytes("head"), to_bytes("body"), {bytes_of(std::size_t{512} << 10)}};
    int sent = 0;
    while (sent < 9'000 && router->send(first->peer, chunk) == SendStatus::sent)
        ++sent;
    CHECK(sent >= 1'024);
    CHECK(sent < 1'500); // some are in the kernel's buffers
    CHECK(router->send(first->peer, {to_bytes("head"), to_bytes("no pixels"), {}}) ==
          SendStatus::sent);
}
