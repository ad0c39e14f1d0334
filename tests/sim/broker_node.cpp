#include "tests/sim/broker_node.hpp"

#include <chrono>
#include <utility>
#include <variant>
#include <vector>

namespace fraja::sim {

using namespace std::chrono_literals;

BrokerNode::BrokerNode(Farm& farm, Process& process, Network& network, Stream& stream)
    : farm_(farm), process_(process), network_(network), stream_(stream), disk_(farm),
      referee_(farm) {
    process_.tick = [this] { step(broker::Tick{}); };
    network_.broker_hears = [this](broker::PeerId peer, protocol::Message&& message) {
        step(broker::PeerSaid{std::move(peer), std::move(message)});
    };
    stream_.subscribed = [this](std::string topic) {
        step(broker::TopicSubscribed{std::move(topic)});
    };
    stream_.unsubscribed = [this](std::string topic) {
        step(broker::TopicUnsubscribed{std::move(topic)});
    };
    disk_.tell = [this](broker::Event&& event) {
        network_.in_process(process_,
                            [this, event = std::move(event)]() mutable { step(std::move(event)); });
    };
}

void BrokerNode::start() {
    network_.begin_life(process_);
    const bool keeps = farm_.scenario.store.there;
    dispatcher_ = std::make_unique<broker::Dispatcher>(
        broker::Dispatcher::Identity{farm_.make_id<BrokerId>(), ++epoch_, "tcp://sim:50058", keeps},
        farm_.scenario.limits);
    if (keeps) {
        broker::Restored restored{disk_.kept().contents(disk_.wall_now()), {}};
        referee_.begin(&restored.contents);
        for (const broker::StoredJob& job : restored.contents.jobs)
            if (!protocol::is_over(job.phase))
                if (auto scene = disk_.kept().scene(job.submission.scene))
                    restored.scenes[job.submission.scene] = std::move(*scene);
        step(std::move(restored));
    } else {
        referee_.begin(nullptr);
    }
    step(broker::Tick{});
    stream_.resubscribe();
}

void BrokerNode::crash() {
    if (!process_.running)
        return;
    ++farm_.report.restarts;
    network_.end_life(process_);
    dispatcher_.reset();
    disk_.crash(farm_.rng.unit() < farm_.scenario.faults.machine_crashes);
    stream_.break_all();
    network_.break_all_lines();
    farm_.agenda.after(farm_.between(10ms, farm_.scenario.faults.restart_max), [this] { start(); });
}

void BrokerNode::step(broker::Event&& first) {
    events_.clear();
    events_.push_back(std::move(first));
    std::vector<broker::Action> actions;
    while (!events_.empty()) {
        farm_.note(1'000 + events_.front().index());
        actions.clear();
        dispatcher_->step(farm_.now(), events_.front(), actions);
        events_.pop_front();
        for (broker::Action& action : actions) {
            referee_.look_at(action);
            std::visit([this](auto& a) { perform(std::move(a)); }, action);
        }
    }
    network_.wake(process_, dispatcher_->next_deadline());
}

void BrokerNode::describe() const {
    if (dispatcher_)
        for (const std::string& line : dispatcher_->describe(farm_.now()))
            farm_.log(line);
}

void BrokerNode::perform(broker::Send&& send) {
    if (!network_.to_node(send.peer, std::move(send.message)))
        events_.push_back(broker::PeerUnreachable{send.peer});
}

void BrokerNode::perform(broker::Publish&& publish) {
    stream_.publish(publish.topic, std::move(publish.message));
}

void BrokerNode::perform(broker::SendStored&& wish) {
    for (const TileIndex tile : wish.tiles) {
        const auto found = disk_.kept().tiles(wish.job, tile);
        if (found.empty())
            farm_.violation("the broker wants a tile from the store that is not there");
        for (const auto& done : found)
            perform(broker::Send{wish.peer, *done});
    }
}

void BrokerNode::perform(broker::LoadScene&& load) {
    events_.push_back(broker::SceneLoaded{load.job, load.peer, disk_.kept().scene(load.scene)});
}

} // namespace fraja::sim
