// The stream: what the broker publishes, to whom it is subscribed; it drops in silence, and may say
// twice.
#pragma once

#include "common/protocol/messages.hpp"
#include "tests/sim/network.hpp"

#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

namespace fraja::sim {

struct Subscriber {
    Line& line; ///< its session's
    std::function<void(const protocol::Message&)> hear;
    std::set<std::string> topics{};
    std::uint64_t generation = 0; ///< of its connection
    Instant last{};               ///< when the last message arrives
};

class Stream {
public:
    Stream(Farm& farm, Network& network, Process& broker)
        : farm_(farm), network_(network), broker_(broker) {}

    std::function<void(std::string)> subscribed, unsubscribed; ///< the broker is told

    void open(Subscriber& subscriber); ///< anew: its topics are forgotten
    void subscribe(Subscriber& subscriber, const std::string& topic);
    void unsubscribe(Subscriber& subscriber, const std::string& topic);
    void publish(const std::string& topic, protocol::Message&& message);

    void break_all();   ///< the broker is gone
    void resubscribe(); ///< it is there again, and found by all sockets
    [[nodiscard]] bool has(const std::string& topic) const { return topics_.contains(topic); }

private:
    void ask(Subscriber& subscriber, const std::string& topic);

    Farm& farm_;
    Network& network_;
    Process& broker_;
    std::map<std::string, std::vector<Subscriber*>> topics_;
    std::vector<Subscriber*> known_;
};

} // namespace fraja::sim
