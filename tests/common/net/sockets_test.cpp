#include "common/net/sockets.hpp"

#include "common/net/clock.hpp"
#include "common/net/signals.hpp"
#include "common/net/waker.hpp"
#include "common/protocol/limits.hpp"

#include <csignal>
#include <doctest/doctest.h>
#include <thread>

using namespace fraja;
using namespace fraja::net;
using namespace std::chrono_literals;

namespace {

template <class S>
auto receive(S& socket) {
    auto received = socket.receive();
    for (int i = 0; !received && i < 100; ++i) {
        wait({socket}, 100ms);
        received = socket.receive();
    }
    REQUIRE(received.has_value());
    return std::move(*received);
}

protocol::Packet packet(std::string_view body, std::size_t blobs = 0) {
    protocol::Packet p{to_bytes("head"), to_bytes(body), {}};
    p.blobs.assign(blobs, make_blob(Bytes(1000, std::byte{3})));
    return p;
}

void send(DealerSocket& dealer, const protocol::Packet& p) {
    while (dealer.send(p) != SendStatus::sent) // until the connection stands
        wait({dealer}, 10ms);
}

} // namespace

TEST_CASE("a message goes from dealer to router and back with its blobs") {
    for (const char* endpoint : {"tcp://127.0.0.1:0", "inproc://net-test"}) {
        CAPTURE(endpoint);
        const Context context;
        auto router = RouterSocket::bind(context, endpoint);
        REQUIRE(router.has_value());
        auto dealer = DealerSocket::connect(context, router->endpoint());
        REQUIRE(dealer.has_value());
        send(*dealer, packet("question", 2));
        const RoutedMessage question = receive(*router);
        REQUIRE(question.frames.size() == 4);
        CHECK(as_text(*question.frames[1]) == "question");
        CHECK(question.frames[3]->size() == 1000);
        CHECK(router->send(question.peer, packet("answer")) == SendStatus::sent);
        CHECK(as_text(*receive(*dealer)[1]) == "answer");
    }
}

TEST_CASE("a router says at once that a peer is not there") {
    const Context context;
    auto router = RouterSocket::bind(context, "tcp://127.0.0.1:0");
    REQUIRE(router.has_value());
    CHECK(router->send("nobody", packet("hello", 1)) == SendStatus::unreachable);
    auto dealer = DealerSocket::connect(context, router->endpoint());
    REQUIRE(dealer.has_value());
    send(*dealer, packet("here")); // what was refused before has left nothing behind
    CHECK(as_text(*receive(*router).frames[1]) == "here");
}

TEST_CASE("a dealer without a connection queues nothing") {
    const Context context;
    auto dealer = DealerSocket::connect(context, "tcp://127.0.0.1:1");
    REQUIRE(dealer.has_value());
    CHECK(dealer->send(packet("x")) == SendStatus::full);
}

TEST_CASE("frames beyond the limit are not kept") {
    const Context context;
    auto router = RouterSocket::bind(context, "tcp://127.0.0.1:0");
    REQUIRE(router.has_value());
    auto dealer = DealerSocket::connect(context, router->endpoint());
    REQUIRE(dealer.has_value());
    send(*dealer, packet("many", 1000));
    send(*dealer, packet("next"));
    CHECK(receive(*router).frames.size() == protocol::message_frames_max + 1);
    CHECK(as_text(*receive(*router).frames[1]) == "next");
}

TEST_CASE("subscribers get their topics and the publisher hears of them") {
    const Context context;
    auto publisher = PublisherSocket::bind(context, "tcp://127.0.0.1:0");
    REQUIRE(publisher.has_value());
    auto subscriber = SubscriberSocket::connect(context, publisher->endpoint());
    REQUIRE(subscriber.has_value());
    subscriber->subscribe("news");
    const SubscriptionChange change = receive(*publisher);
    CHECK(change.topic == "news");
    CHECK(change.subscribed);
    publisher->publish("gossip", packet("no"));
    publisher->publish("news", packet("yes", 1));
    const PublishedMessage message = receive(*subscriber);
    CHECK(message.topic == "news");
    REQUIRE(message.frames.size() == 3);
    CHECK(as_text(*message.frames[1]) == "yes");
    subscriber->unsubscribe("news");
    CHECK_FALSE(receive(*publisher).subscribed);
}

TEST_CASE("subscriptions arrive in the order in which they were made") {
    // A barrier rests on this: when its nonce is seen, the job's subscription before it stands. So
    // it must hold for a connection that comes up later as well.
    std::string taken;
    {
        const Context context;
        taken = PublisherSocket::bind(context, "tcp://127.0.0.1:0")->endpoint();
    }
    for (const std::string& endpoint : {taken, std::string("inproc://late-publisher")}) {
        CAPTURE(endpoint);
        const Context context;
        auto subscriber = SubscriberSocket::connect(context, endpoint);
        REQUIRE(subscriber.has_value());
        subscriber->subscribe("J1");
        subscriber->subscribe("N2");
        auto publisher = PublisherSocket::bind(context, endpoint);
        REQUIRE(publisher.has_value());
        CHECK(receive(*publisher).topic == "J1");
        CHECK(receive(*publisher).topic == "N2");
    }
}

TEST_CASE("binding a taken or impossible endpoint is an error with its name") {
    const Context context;
    auto first = RouterSocket::bind(context, "tcp://127.0.0.1:0");
    REQUIRE(first.has_value());
    const auto second = RouterSocket::bind(context, first->endpoint());
    REQUIRE_FALSE(second.has_value());
    CHECK(second.error().code == ErrorCode::io);
    CHECK(second.error().message.find(first->endpoint()) != std::string::npos);
    CHECK_FALSE(PublisherSocket::bind(context, "nonsense").has_value());
    CHECK_FALSE(DealerSocket::connect(context, "nonsense").has_value());
    CHECK_FALSE(SubscriberSocket::connect(context, "nonsense").has_value());
}

TEST_CASE("a waker ends a wait from another thread") {
    const Waker waker;
    std::jthread other([&] { waker.wake(); });
    const Instant start = now();
    wait({waker.fd()}, 30s);
    CHECK(now() - start < 20s);
    waker.drain();
}

TEST_CASE("a signal can be waited for") {
    const SignalWatch watch({SIGUSR2});
    CHECK_FALSE(watch.receive().has_value());
    raise(SIGUSR2);
    wait({watch.fd()}, 30s);
    CHECK(watch.receive() == SIGUSR2);
}
