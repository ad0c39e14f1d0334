#include "tests/sim/stream.hpp"

#include <algorithm>
#include <utility>

namespace fraja::sim {

void Stream::open(Subscriber& subscriber) {
    if (std::ranges::find(known_, &subscriber) == known_.end())
        known_.push_back(&subscriber);
    ++subscriber.generation;
    for (const std::string& topic : std::exchange(subscriber.topics, {}))
        unsubscribe(subscriber, topic);
}

void Stream::subscribe(Subscriber& subscriber, const std::string& topic) {
    subscriber.topics.insert(topic);
    ask(subscriber, topic);
}

void Stream::ask(Subscriber& subscriber, const std::string& topic) {
    const std::uint64_t generation = subscriber.generation, life = broker_.life;
    subscriber.last = std::max(subscriber.last, farm_.now() + farm_.delay());
    farm_.agenda.at(subscriber.last, [this, &subscriber, topic, generation, life] {
        if (subscriber.generation != generation || broker_.life != life || !broker_.running ||
            !subscriber.topics.contains(topic))
            return;
        network_.in_process(broker_, [this, &subscriber, topic] {
            auto& subscribers = topics_[topic];
            if (std::ranges::find(subscribers, &subscriber) == subscribers.end())
                subscribers.push_back(&subscriber);
            subscribed(topic);
        });
    });
}

void Stream::unsubscribe(Subscriber& subscriber, const std::string& topic) {
    subscriber.topics.erase(topic);
    const auto found = topics_.find(topic);
    if (found == topics_.end() || std::erase(found->second, &subscriber) == 0 ||
        !found->second.empty())
        return;
    topics_.erase(found);
    if (broker_.running)
        farm_.agenda.after(farm_.delay(), [this, topic, life = broker_.life] {
            if (broker_.life == life && !topics_.contains(topic))
                network_.in_process(broker_, [this, topic] { unsubscribed(topic); });
        });
}

void Stream::publish(const std::string& topic, protocol::Message&& message) {
    const auto subscribers = topics_.find(topic);
    if (subscribers == topics_.end())
        return;
    const auto shared = std::make_shared<const protocol::Message>(std::move(message));
    for (Subscriber* subscriber : subscribers->second) {
        if (!farm_.healed() && farm_.rng.unit() < farm_.scenario.faults.stream_drop)
            continue;
        subscriber->last = std::max(
            {subscriber->last, farm_.now() + farm_.delay(), subscriber->line.silent_until});
        const auto arrive = [this, subscriber, generation = subscriber->generation, shared] {
            if (subscriber->generation == generation)
                network_.in_process(subscriber->line.owner,
                                    [subscriber, shared] { subscriber->hear(*shared); });
        };
        farm_.agenda.at(subscriber->last, arrive);
        if (const auto lag = farm_.duplicate_lag())
            farm_.agenda.at(subscriber->last + *lag, arrive);
    }
}

void Stream::break_all() {
    topics_.clear();
    for (Subscriber* subscriber : known_)
        ++subscriber->generation;
}

void Stream::resubscribe() {
    for (Subscriber* subscriber : known_)
        for (const std::string& topic : subscriber->topics)
            ask(*subscriber, topic);
}

} // namespace fraja::sim
