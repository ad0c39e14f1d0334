#include "tests/sim/broker_node.hpp"

#include <chrono>
#include <utility>
#include <variant>
#include <vector>

namespace fraja::sim {

using namespace std::chrono_literals;

BrokerNode::BrokerNode(Farm& farm, const Sites& sites, std::size_t index)
    : farm_(farm), sites_(sites), site_(*sites[index]), name_("broker " + std::to_string(index)),
      process_(site_.process), network_(site_.network), stream_(site_.stream), disk_(farm),
      referee_(farm) {
    for (const auto& other : sites) {
        if (other.get() == &site_)
            continue;
        Call& call = *calls_.emplace(other->endpoint, std::make_unique<Call>(*other, process_))
                          .first->second;
        call.line.hear = [this, &call](protocol::Message&& message) {
            step(broker::BrokerSaid{call.site.endpoint, std::move(message)});
        };
    }
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
    std::vector<std::string> peers; // some know only the first one, which tells of all
    for (const auto& other : sites_)
        if (other.get() != &site_ &&
            (farm_.rng.below(2) == 0 || other == sites_.front() || &site_ == sites_.front().get()))
            peers.push_back(other->endpoint);
    dispatcher_ = std::make_unique<broker::Dispatcher>(
        broker::Dispatcher::Identity{.broker = farm_.make_id<BrokerId>(),
                                     .epoch = next_epoch(),
                                     .stream = "tcp://sim:50058",
                                     .keeps = keeps,
                                     .started_at = farm_.now(),
                                     .unix_offset = disk_.wall_now() - farm_.now().since_start,
                                     .endpoint = sites_.size() > 1 ? site_.endpoint : std::string(),
                                     .peers = std::move(peers),
                                     .check_key = farm_.scenario.seed},
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

/// As the store and the shell have it: microseconds, where the clock has not been set back.
std::uint64_t BrokerNode::next_epoch() {
    const auto now_us = static_cast<std::uint64_t>(disk_.wall_now().count() / 1'000);
    return farm_.scenario.store.there ? disk_.next_epoch(now_us) : now_us;
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
    for (const auto& [endpoint, call] : calls_) {
        call->site.network.disconnect(call->line);
        ++call->line.socket;
    }
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
            farm_.log(name_ + ": " + line);
}

void BrokerNode::perform(broker::Send&& send) {
    if (!network_.to_node(send.peer, std::move(send.message)))
        events_.push_back(broker::PeerUnreachable{send.peer});
}

std::vector<Node> BrokerNode::lines() {
    std::vector<Node> all;
    for (const auto& [endpoint, call] : calls_)
        all.push_back({&call->line, &call->site.network});
    return all;
}

void BrokerNode::perform(broker::Dial&& dial) {
    const auto found = calls_.find(dial.endpoint);
    if (found == calls_.end())
        return farm_.violation(name_ + " calls " + dial.endpoint);
    if (!found->second->line.wanted)
        found->second->site.network.connect(found->second->line);
}

void BrokerNode::perform(broker::HangUp&& gone) {
    const auto found = calls_.find(gone.endpoint);
    if (found == calls_.end())
        return farm_.violation(name_ + " hangs up on " + gone.endpoint);
    Call& call = *found->second;
    call.site.network.disconnect(call.line);
    ++call.line.socket;
}

void BrokerNode::perform(broker::Tell&& words) {
    const auto found = calls_.find(words.endpoint);
    if (found == calls_.end())
        return farm_.violation(name_ + " speaks to " + words.endpoint);
    Call& call = *found->second;
    (void)call.site.network.to_broker(call.line, words.message);
}

void BrokerNode::perform(broker::Publish&& publish) {
    stream_.publish(publish.topic, std::move(publish.message));
}

void BrokerNode::perform(broker::SendStored&& wish) {
    for (const TileIndex tile : wish.tiles) {
        const auto found = disk_.kept().tiles(wish.job, tile);
        if (found.empty())
            farm_.violation("the broker wants a tile from the store that is not there");
        for (const auto& done : found) {
            protocol::TileDone sent = *done;
            sent.epoch = wish.epoch;
            perform(broker::Send{wish.peer, std::move(sent)});
        }
    }
}

void BrokerNode::perform(broker::LoadScene&& load) {
    events_.push_back(broker::SceneLoaded{load.job, load.peer, disk_.kept().scene(load.scene)});
}

} // namespace fraja::sim
