#include "tests/chaos/peer.hpp"

#include "common/base/assert.hpp"
#include "common/protocol/codec.hpp"

namespace fraja::chaos {
namespace {

net::DealerSocket connected(const net::Context& context, const std::string& endpoint) {
    auto socket = net::DealerSocket::connect(context, endpoint);
    FRAJA_ASSERT(socket.has_value());
    return std::move(*socket);
}

} // namespace

Peer::Peer(const net::Context& context, const std::string& endpoint)
    : socket_(connected(context, endpoint)) {}

bool Peer::say(const protocol::Packet& packet, Duration timeout) {
    const Instant end = net::now() + timeout;
    while (socket_.send(packet) != net::SendStatus::sent) {
        if (net::now() >= end)
            return false;
        net::wait({socket_}, std::chrono::milliseconds(5)); // nothing tells of a new connection
    }
    return true;
}

bool Peer::say(const protocol::Message& message, Duration timeout) {
    return say(protocol::encode(message), timeout);
}

std::optional<protocol::Message> Peer::hear(Duration timeout) {
    const Instant end = net::now() + timeout;
    for (;;) {
        while (const auto frames = socket_.receive())
            if (auto message = protocol::decode(*frames))
                return std::move(*message);
        const Instant now = net::now();
        if (now >= end)
            return std::nullopt;
        net::wait({socket_}, end - now);
    }
}

protocol::WorkerHello hello_of(const std::string& name, std::uint32_t credit) {
    protocol::WorkerHello hello;
    hello.worker = random_id<WorkerId>();
    hello.incarnation = 1;
    hello.worker_name = name;
    hello.threads = 1;
    hello.credit = credit;
    hello.program_version = "test";
    return hello;
}

} // namespace fraja::chaos
