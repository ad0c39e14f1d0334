// A peer that says whatever a test wants it to.
#pragma once

#include "common/net/clock.hpp"
#include "common/net/sockets.hpp"
#include "common/protocol/messages.hpp"

#include <optional>
#include <string>

namespace fraja::chaos {

class Peer {
public:
    /// Aborts where the endpoint is none.
    Peer(const net::Context& context, const std::string& endpoint);

    /// False: there has been no connection for as long as `timeout`.
    bool say(const protocol::Message& message, Duration timeout = std::chrono::seconds(60));
    bool say(const protocol::Packet& packet, Duration timeout = std::chrono::seconds(60));
    /// The next message, or nothing within the time.
    [[nodiscard]] std::optional<protocol::Message> hear(Duration timeout);
    /// The next message of that kind; others are dropped.
    template <class M>
    [[nodiscard]] std::optional<M> hear_only(Duration timeout);

private:
    net::DealerSocket socket_;
};

/// A worker's first words, with an id and a name of its own.
[[nodiscard]] protocol::WorkerHello hello_of(const std::string& name, std::uint32_t credit);

template <class M>
std::optional<M> Peer::hear_only(Duration timeout) {
    const Instant end = net::now() + timeout;
    while (auto message = hear(end - net::now()))
        if (auto* wanted = std::get_if<M>(&*message))
            return std::move(*wanted);
    return std::nullopt;
}

} // namespace fraja::chaos
