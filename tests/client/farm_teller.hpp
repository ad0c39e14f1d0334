// FarmTeller: a broker of few words on ports that the system picks, which tells of its farm.
#pragma once

#include "common/net/sockets.hpp"
#include "common/protocol/codec.hpp"
#include "common/protocol/topics.hpp"

#include <chrono>
#include <cstdint>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace fraja::client {

/// Welcomes all, and publishes its farm to whoever asks for that.
class FarmTeller {
public:
    FarmTeller(const net::Context& context, std::uint8_t id,
               std::vector<protocol::PeerState> others = {})
        : router_(*net::RouterSocket::bind(context, "tcp://127.0.0.1:0")),
          publisher_(*net::PublisherSocket::bind(context, "tcp://127.0.0.1:0", 1'000)),
          endpoint_(router_.endpoint()) {
        farm_.broker.broker = BrokerId{{id}};
        if (!others.empty()) {
            farm_.brokers = std::move(others);
            farm_.brokers.insert(farm_.brokers.begin(), {.broker = BrokerId{{id}},
                                                         .endpoint = endpoint_,
                                                         .program_version = "1",
                                                         .is_here = true,
                                                         .is_synced = true,
                                                         .leads = true});
        }
        thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
    }
    [[nodiscard]] const std::string& endpoint() const { return endpoint_; }

private:
    void run(const std::stop_token& stop) {
        while (!stop.stop_requested()) {
            net::wait({router_, publisher_}, std::chrono::milliseconds(10));
            while (const auto change = publisher_.receive())
                if (change->subscribed && change->topic == protocol::farm_topic)
                    publisher_.publish(change->topic, protocol::encode(farm_));
            while (const auto in = router_.receive())
                if (const auto message = protocol::decode(in->frames);
                    message && std::holds_alternative<protocol::ClientHello>(*message))
                    (void)router_.send(in->peer,
                                       protocol::encode(protocol::Welcome{
                                           farm_.broker.broker, 1, std::chrono::seconds(1), 3,
                                           publisher_.endpoint(), "test"}));
        }
    }

    net::RouterSocket router_;
    net::PublisherSocket publisher_;
    std::string endpoint_;
    protocol::FarmState farm_;
    std::jthread thread_; // last: it uses the others
};

} // namespace fraja::client
